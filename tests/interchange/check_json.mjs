// Checks a file of `tether log mcap` against the tables of `tether log csv`, our schemas and Foxglove's.
// Usage: node check_json.mjs FILE.mcap CSV_FOLDER

import * as foxglove from "@foxglove/schemas/jsonschema.js";
import Ajv from "ajv";
import { check, nanoseconds, readMcap, readTables } from "./mcap_files.mjs";

const [file, folder] = process.argv.slice(2);
const { header, channels, messages } = await readMcap(file);
const tables = readTables(folder);
const ajv = new Ajv({ strict: false, validateFormats: false });
const text = new TextDecoder("utf-8", { fatal: true });
const validators = new Map();

/// Foxglove's and Lichtblick's viewers refuse a whole file for a field without one of these types.
function checkViewable(schema, where) {
  check(["object", "array", "string", "number", "integer", "boolean"].includes(schema.type), where);
  if (schema.type === "array") checkViewable(schema.items, `${where}[]`);
  if (schema.type !== "object") return;
  for (const [name, field] of Object.entries(schema.properties)) checkViewable(field, `${where}.${name}`);
}

function validate(schema, value) {
  if (!validators.has(schema.name)) {
    const parsed = JSON.parse(text.decode(schema.data));
    checkViewable(parsed, schema.name);
    const ours = ajv.compile(parsed);
    const theirs = schema.name.startsWith("foxglove.")
      ? ajv.compile(foxglove[schema.name.replace("foxglove.", "")])
      : ours;
    validators.set(schema.name, [ours, theirs]);
  }
  for (const validator of validators.get(schema.name)) {
    check(validator(value), `${schema.name}: ${JSON.stringify(validator.errors)}`);
  }
}

function same(value, cell) {
  if (Array.isArray(value)) {
    const cells = value.length === 0 && cell === "" ? [] : cell.split(";");
    return cells.length === value.length && value.every((x, i) => same(x, cells[i]));
  }
  if (typeof value === "boolean") return cell === (value ? "1" : "0");
  if (typeof value === "number") return Number(cell) === value;
  return value === cell;
}

check(header.profile === "", `profile ${header.profile}`);
const rows = new Map([...tables].map(([name, table]) => [name, table.values()]));
const seen = new Map();
for (const { topic, schema, encoding, logTime, publishTime, sequence, data } of messages) {
  check(encoding === "json" && schema.encoding === "jsonschema", `${topic} is no JSON`);
  const value = JSON.parse(text.decode(data));
  validate(schema, value);
  seen.set(topic, (seen.get(topic) ?? 0) + 1);
  if (topic.startsWith("VIEW/")) continue;
  const row = rows.get(topic.replace("/", "_")).next().value;
  check(row !== undefined, `${topic}: more messages than rows`);
  check(logTime === nanoseconds(row.t_s) && publishTime === logTime, `${topic}: time ${logTime}`);
  check(sequence === value.seq, `${topic}: sequence ${sequence}`);
  check(Object.keys(value).join() === Object.keys(row).slice(1).join(), `${topic}: other fields`);
  for (const [name, field] of Object.entries(value)) {
    check(same(field, row[name]), `${topic}.${name}: ${field} and not ${row[name]}`);
  }
}
for (const [name, rest] of rows) check(rest.next().done, `${name}: more rows than messages`);
const views = ["VIEW/SCENE", "VIEW/FRAMES", "VIEW/REFERENCE", ...(tables.has("AGV_SCAN") ? ["VIEW/SCAN"] : [])];
for (const view of views) check(seen.get(view) > 0, view);
check(channels.length === tables.size + views.length, `${channels.length} channels`);

// Viewers draw at the true pose.
const truth = tables.get("SIM_TRUTH").values();
for (const { topic, data } of messages) {
  if (topic !== "VIEW/FRAMES") continue;
  const { child_frame_id, translation, rotation } = JSON.parse(text.decode(data));
  if (child_frame_id !== "SIM/TRUTH") continue;
  const row = truth.next().value;
  const yaw = 2 * Math.atan2(rotation.z, rotation.w);
  check(translation.x === Number(row.x_m) && translation.y === Number(row.y_m), "frame");
  check(Math.abs(Math.sin(yaw - Number(row.yaw_rad))) < 1e-12, `yaw ${yaw} and not ${row.yaw_rad}`);
}
check(truth.next().done, "fewer frames than truths");

// Scans have the beams of the log, in the frame of the truth.
const scans = tables.get("AGV_SCAN")?.values();
for (const { topic, data } of messages) {
  if (topic !== "VIEW/SCAN") continue;
  const { frame_id, pose, ranges } = JSON.parse(text.decode(data));
  const row = scans.next().value;
  check(frame_id === "SIM/TRUTH" && pose.position.x === Number(row.mount_x_m), "scan's place");
  check(ranges.join() === row.range_m.split(";").map(Number).join(), `scan at ${row.t_s} s`);
}
check(scans === undefined || scans.next().done, "fewer scans than in the log");
console.log(`${messages.length} messages on ${channels.length} channels, as the tables and schemas say`);
