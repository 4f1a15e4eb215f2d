// Which LCM channel means what, and the one place that knows how the server names things.

/**
 * "AGV7/POSE" -> {side: "AGV7", base: "AGV", name: "POSE", vehicle: "7"}; null for what is no such
 * channel. A vehicle that is not called AGV… has Truck/… and CTRL-Truck/… (channel_names.hpp).
 */
export function splitTopic(topic) {
  let part = parts.get(topic);
  if (part === undefined) parts.set(topic, (part = split(topic)));
  return part;
}

const parts = new Map();

function split(topic) {
  const slash = topic.indexOf("/");
  if (slash <= 0) return null;
  const side = topic.slice(0, slash);
  const [, base, vehicle] = /^(AGV|CTRL|CAN|SIM|NET)(.*)$/.exec(side) ?? [null, side, NO_VEHICLE.has(side) ? "" : side];
  return { side, base, name: topic.slice(slash + 1), vehicle: vehicle.replace(/^-/, "") };
}

/** The key of a vehicle by its name, as splitTopic has it. */
export function vehicleKey(name) {
  return name.startsWith("AGV") ? name.slice(3) : name;
}

/** CTRL/…, CTRL7/…: behind the network, where the controller is. */
export function isControlSide(part) {
  return part.base === "CTRL";
}

/** Sides that are no vehicle. */
const NO_VEHICLE = new Set(["CTRL", "NET", "SIM", "CAN", "TIME", "RUN", "LINK"]);

export function isVehicleSide(part) {
  return !NO_VEHICLE.has(part.base);
}

/** What the page subscribes to: what LCM carries, not what the server draws from it for others. */
export function isWanted(channel) {
  return !String(channel.schemaName).startsWith("foxglove.");
}

/** Where the server describes the run: its kind, path, scenario, parameters (run_json.hpp). */
export const ABOUT_ADDRESS = "api/run.json";

export const IN_EFFECT = "network.in_effect";

/** Of the topics on which the server lets the page publish: {request, twist}, undefined if there is none. */
export function topicsOf(publishable) {
  return {
    request: publishable.find((topic) => topic.startsWith("CAN") && topic.endsWith("/REQUEST")),
    twist: publishable.find((topic) => topic.startsWith("CTRL") && topic.endsWith("/CMD_VEL")),
  };
}

export const REQUEST_SCHEMA = "tether.drive_request_t";

export const TWIST_SCHEMA = "tether.twist_t";

export const PLAYBACK = {
  position: "playback.position_s",
  speed: "playback.speed",
  playing: "playback.playing",
  start: "playback.start_s",
  end: "playback.end_s",
};
