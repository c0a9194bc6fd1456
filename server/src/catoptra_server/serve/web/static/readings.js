/**
 * Sensor readings from lines of the control protocol (protocol/SPEC.md, chapters 3 and 5).
 *
 * `SEN {Time 1.2} {Type Sonar} {Name F1 Range 4.5} {Name F2 Range 2.4}`: a word, then blocks of a
 * name and a value. Where a name repeats the first counts, except for the parts of a sensor of
 * many, each of which has a block of its own.
 */

const BLOCK = /\{([^{}]*)\}/g;
const MAX_BLOCKS = 1024;
const MAX_PARTS = 256;

/** The blocks of a line as pairs of name and value, both trimmed. */
function blocksOf(line) {
  const blocks = [];
  for (const [, inside] of line.matchAll(BLOCK)) {
    if (blocks.length === MAX_BLOCKS) break;
    const text = inside.trim();
    const space = text.indexOf(" ");
    blocks.push(space < 0 ? ["", text] : [text.slice(0, space), text.slice(space + 1).trim()]);
  }
  return blocks;
}

/** `F1 Range 4.5` as a part; null for the plain name of a sensor. */
function partOf(value) {
  const words = value.split(/ +/);
  if (words.length < 3) return null;
  return { name: words[0], quantity: words[1], value: words.slice(2).join(" ") };
}

/**
 * A line as {word: SEN, STA or MISSTA; type, such as RangeScanner; name, empty for sensors of many
 * parts; time_s; fields and labels: values and names as sent, by name in lower case; parts}; null
 * for a line of another kind.
 */
export function parseReading(line) {
  const word = /^[^\s{]*/.exec(line.trim())[0].toUpperCase();
  if (word !== "SEN" && word !== "STA" && word !== "MISSTA") return null;
  const fields = new Map();
  const labels = new Map();
  const parts = [];
  for (const [name, value] of blocksOf(line)) {
    const key = name.toLowerCase();
    const part = key === "name" ? partOf(value) : null;
    if (part && parts.length < MAX_PARTS) parts.push(part);
    if (part || fields.has(key)) continue;
    fields.set(key, value);
    labels.set(key, name);
  }
  const [time_s] = numbersOf(fields.get("time") ?? "");
  const type = fields.get("type") ?? word;
  const name = fields.get("name") ?? "";
  return { word, type, name, time_s: time_s ?? null, fields, labels, parts };
}

/** Key of a sensor in the map of readings. */
export const readingKey = (type, name) => `${type}/${name}`;

/** The readings of all lines, by `readingKey`; the last of a sensor counts. */
export function parseReadings(reports) {
  const readings = new Map();
  for (const line of reports) {
    const reading = parseReading(line);
    if (reading) readings.set(readingKey(reading.type, reading.name), reading);
  }
  return readings;
}

/** The finite numbers of a value, separated by commas or spaces; empty for a value of words. */
export function numbersOf(text) {
  const numbers = text.split(/[\s,]+/).filter(Boolean).map(Number);
  return numbers.every(Number.isFinite) ? numbers : [];
}
