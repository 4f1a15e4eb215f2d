// Checks a bag of `tether log mcap --ros2`: decodes each message by the bag's schemas, encodes it again
// to the same bytes, compares the schemas with ROS 2's own, and the values with `tether log csv`.
// Usage: node check_ros2.mjs FILE.mcap CSV_FOLDER

import { parse } from "@foxglove/rosmsg";
import { ros2humble, ros2jazzy } from "@foxglove/rosmsg-msgs-common";
import { MessageReader, MessageWriter } from "@foxglove/rosmsg2-serialization";
import { check, nanoseconds, readMcap, readTables } from "./mcap_files.mjs";

const [file, folder] = process.argv.slice(2);
const { header, channels, messages } = await readMcap(file);
const tables = readTables(folder);
check(header.profile === "ros2", `profile ${header.profile}`);
for (const channel of channels) {
  check(channel.messageEncoding === "cdr", `${channel.topic} is no CDR`);
  check(channel.metadata.has("offered_qos_profiles"), `${channel.topic} says nothing of QoS`);
  check(/^(\/[a-z_][a-z0-9_]*)+$/.test(channel.topic), `${channel.topic} is no topic`);
}

/// Names and types of fields, as ROS 2 has them.
function fieldsOf(definition) {
  return definition.definitions.map(({ name, type, isArray, arrayLength }) =>
    [name, type.replace("builtin_interfaces/Time", "time"), isArray ?? false, arrayLength ?? null].join(" "),
  );
}

function definitionsOf(schema) {
  const text = new TextDecoder().decode(schema.data);
  const all = parse(text, { ros2: true });
  const [main, ...needed] = all;
  const name = schema.name.replace("/msg/", "/");
  for (const ours of [{ ...main, name }, ...needed]) {
    for (const distribution of [ros2humble, ros2jazzy]) {
      const theirs = distribution[ours.name];
      if (theirs === undefined) check(ours.name === "builtin_interfaces/Time", ours.name);
      else check(fieldsOf(ours).join() === fieldsOf(theirs).join(), `${ours.name} is not ROS 2's`);
    }
  }
  return all;
}

const codecs = new Map();
const topics = new Map();
for (const { topic, schema, logTime, data } of messages) {
  check(schema.encoding === "ros2msg", `${topic}: ${schema.encoding}`);
  if (!codecs.has(schema.name)) {
    const definitions = definitionsOf(schema);
    codecs.set(schema.name, [new MessageReader(definitions), new MessageWriter(definitions)]);
  }
  const [reader, writer] = codecs.get(schema.name);
  const value = reader.readMessage(data);
  check(Buffer.compare(writer.writeMessage(value), data) === 0, `${topic}: encodes to other bytes`);
  if (!topics.has(topic)) topics.set(topic, []);
  topics.get(topic).push({ ...value, logTime });
}

/// What is beside the rows of a table must agree with them, message by message.
function compare(topic, table, values) {
  const rows = tables.get(table);
  const all = topics.get(topic) ?? [];
  check(all.length === rows.length, `${topic}: ${all.length} messages of ${rows.length} rows`);
  all.forEach((message, i) => {
    check(message.logTime === nanoseconds(rows[i].t_s), `${topic}: time`);
    for (const [column, value] of Object.entries(values(message))) {
      const expected = Number(rows[i][column]);
      const near = column === "yaw_rad" ? Math.abs(Math.sin(value - expected)) < 1e-12 : value === expected;
      check(near, `${topic}: ${column} ${value} and not ${rows[i][column]}`);
    }
  });
}

const utime = ({ sec, nsec, nanosec }) => sec * 1e6 + (nsec ?? nanosec) / 1e3;
const yaw = ({ z, w }) => 2 * Math.atan2(z, w);
const place = ({ position, orientation }) => ({ x_m: position.x, y_m: position.y, yaw_rad: yaw(orientation) });
const speed = ({ linear, angular }) => ({ v_mps: linear.x, omega_radps: angular.z });
const odometry = ({ header: { stamp }, pose: { pose, covariance }, twist: { twist } }) => ({
  utime: utime(stamp),
  ...place(pose),
  ...speed(twist),
  cov_x_x_m2: covariance[0],
  cov_x_y_m2: covariance[6],
  cov_x_yaw_m_rad: covariance[30],
  cov_y_y_m2: covariance[7],
  cov_y_yaw_m_rad: covariance[11],
  cov_yaw_yaw_rad2: covariance[35],
});

compare("/clock", "SIM_CLOCK", ({ clock }) => ({ utime: utime(clock) }));
compare("/cmd_vel", "AGV_CMD_VEL", speed);
compare("/ctrl/cmd_vel", "CTRL_CMD_VEL", speed);
for (const side of ["AGV", "CTRL"]) {
  compare(`/${side.toLowerCase()}/pose`, `${side}_POSE`, ({ header: { stamp }, pose }) => ({
    utime: utime(stamp),
    ...place(pose),
  }));
}
compare("/odom", "AGV_ODOMETRY", odometry);
compare("/ground_truth", "SIM_TRUTH", ({ header: { stamp }, pose, twist }) => ({
  utime: utime(stamp),
  ...place(pose.pose),
  ...speed(twist.twist),
}));
const mounts = topics.get("/tf").filter(({ transforms }) => transforms[0].child_frame_id === "laser");
topics.set("/tf", topics.get("/tf").filter(({ transforms }) => transforms[0].child_frame_id !== "laser"));
compare("/tf", "SIM_TRUTH", ({ transforms: [odom, base] }) => {
  check(odom.header.frame_id === "map" && odom.child_frame_id === "odom", "map → odom");
  check(base.header.frame_id === "map" && base.child_frame_id === "base_link", "map → base_link");
  const { translation, rotation } = base.transform;
  return { utime: utime(base.header.stamp), x_m: translation.x, y_m: translation.y, yaw_rad: yaw(rotation) };
});

// Scans: floats of the table's numbers; +inf where nothing came back.
topics.set("mounts", mounts);
compare("mounts", "AGV_SCAN", ({ transforms: [{ header, transform }] }) => {
  check(header.frame_id === "base_link", "base_link → laser");
  const { translation, rotation } = transform;
  return { utime: utime(header.stamp), mount_x_m: translation.x, mount_y_m: translation.y, mount_yaw_rad: yaw(rotation) };
});
let beams = 0;
topics.get("/scan").forEach((scan, i) => {
  const row = tables.get("AGV_SCAN")[i];
  const number = (column) => Number(row[column]);
  const last = number("angle_min_rad") + (number("count") - 1) * number("angle_increment_rad");
  for (const [field, expected] of [["angle_min", number("angle_min_rad")], ["angle_max", last],
    ["angle_increment", number("angle_increment_rad")], ["time_increment", number("time_increment_s")],
    ["range_min", number("range_min_m")], ["range_max", number("range_max_m")], ["scan_time", 0]]) {
    check(scan[field] === Math.fround(expected), `/scan: ${field} ${scan[field]} and not ${expected}`);
  }
  check(scan.header.frame_id === "laser" && utime(scan.header.stamp) === number("utime"), "/scan: header");
  const ranges = row.range_m.split(";").map((range) => Math.fround(Number(range)) || Infinity);
  check(scan.ranges.length === number("count") && scan.ranges.every((range, k) => range === ranges[k]), "/scan: ranges");
  beams += scan.ranges.filter(Number.isFinite).length;
});
check(topics.get("/scan").length === tables.get("AGV_SCAN").length && beams > 1000, `/scan: ${beams} beams`);

// The path begins where the reference does, and is where it is, whenever both have a point.
const [plan] = topics.get("/plan");
const references = new Map(tables.get("SIM_TRUTH").map((row) => [Number(row.utime), row]));
let met = 0;
for (const { header: { stamp }, pose } of plan.poses) {
  const row = references.get(utime(stamp));
  if (row === undefined) continue;
  ++met;
  const off_m = Math.hypot(pose.position.x - Number(row.x_ref_m), pose.position.y - Number(row.y_ref_m));
  check(off_m < 1e-9, `/plan is ${off_m} m off the reference at ${row.t_s} s`);
}
check(met > 50, `only ${met} points of /plan compared`);
console.log(`${messages.length} messages on ${channels.length} topics, as the tables and ROS 2 say`);
