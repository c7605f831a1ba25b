// placeholder
export class LivePoses {}
