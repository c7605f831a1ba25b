// Colours of what is shown: of contours as in palpate's pictures.

export const KINDS = ["#b1121f", "#3d9be0", "#6a4c93"]; // object, hand, made
export const KIND_NAMES = ["object's contour", "hand's boundary inside it", "made by a stage"];
export const FILES = ["#2b2d42", "#2a9d8f"]; // lines of the plots
export const SOLID = "#8d99ae";
export const PALM = "#f4a261";
export const HAND = "#e3b8a2";
export const ARRAY = "#5a6068";
export const ZONE = "#c6cbd2";
export const LAYERS = { object: SOLID, hand: HAND, skin: PALM, array: ARRAY }; // those without a line in the legend
export const FOCUS = "#141414";
export const JUMP = "#d628a0";
export const HOP = "#f77f00";
export const PAPER = "#ffffff";
