// Arrays of the page's content; packing.py describes the codecs.

const NUMBERS = { f8: Float64Array, f4: Float32Array, u4: Uint32Array, u2: Uint16Array, u1: Uint8Array };

export async function inflate(text) {
  const binary = atob(text);
  const bytes = new Uint8Array(binary.length);
  for (let i = 0; i < bytes.length; i++) bytes[i] = binary.charCodeAt(i);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Response(stream).arrayBuffer();
}

// Replaces each description of an array (an object with a codec) in the page's JSON by the array.
export function decode(described, content) {
  if (Array.isArray(described)) return described.map((each) => decode(each, content));
  if (described === null || typeof described !== "object") return described;
  if (typeof described.codec === "string") {
    return described.codec === "steps" ? readSteps(described, content) : readNumbers(described, content);
  }
  return Object.fromEntries(Object.entries(described).map(([name, each]) => [name, decode(each, content)]));
}

function readNumbers({ codec, shape, at }, content) {
  const Kind = NUMBERS[codec];
  const size = shape.reduce((a, b) => a * b, 1) * Kind.BYTES_PER_ELEMENT;
  return new Kind(content.slice(at, at + size)); // a copy, as views of several bytes must begin at multiples of them
}

function readSteps({ shape: [rows, columns], at, origin, step }, content) {
  const count = rows * columns;
  const low = new Uint8Array(content, at, count);
  const high = new Uint8Array(content, at + count, count);
  const values = new Float32Array(count);
  for (let column = 0; column < columns; column++) {
    let whole = 0;
    for (let row = 0; row < rows; row++) {
      const folded = low[column * rows + row] | (high[column * rows + row] << 8);
      whole = (whole + ((folded >> 1) ^ -(folded & 1))) & 0xffff;
      values[row * columns + column] = origin + whole * step;
    }
  }
  return values;
}
