// Processor time of Chromium's pages: says what a picture costs, however busy the machine is.
import fs from "node:fs";

const TICKS_PER_S = 100; // USER_HZ of Linux

function stat(pid) {
  const fields = fs.readFileSync(`/proc/${pid}/stat`, "utf8").split(") ").pop().split(" ");
  return { parent: Number(fields[1]), ticks: Number(fields[11]) + Number(fields[12]) };
}

/** Seconds that the renderers among the descendants of `root` have computed so far. */
export function cpuOfRenderers(root) {
  const processes = new Map();
  for (const pid of fs
    .readdirSync("/proc")
    .filter((name) => /^\d+$/.test(name))
    .map(Number)) {
    try {
      const { parent, ticks } = stat(pid);
      const isRenderer = fs.readFileSync(`/proc/${pid}/cmdline`, "utf8").includes("--type=renderer");
      processes.set(pid, { parent, ticks, isRenderer });
    } catch {
      // it has ended
    }
  }
  const isOurs = (pid) => {
    for (let at = pid; at > 1; at = processes.get(at)?.parent ?? 0) if (at === root) return true;
    return false;
  };
  let ticks = 0;
  for (const [pid, one] of processes) if (one.isRenderer && isOurs(pid)) ticks += one.ticks;
  return ticks / TICKS_PER_S;
}
