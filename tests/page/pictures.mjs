// node pictures.mjs TETHER SCENARIO WORK OUT: the pictures of the documentation, from logs in WORK. The animation's
// frames go to WORK/frames.
import fs from "node:fs";
import path from "node:path";
import { LAPTOP, launch, serve, sleep, until } from "./browser.mjs";

const [tether, scenario, work, out] = process.argv.slice(2);
const STEP_S = 0.5;
const END_S = 62;

/** The run's time that the page shows. */
const runTime = (page) => page.$eval("#run-time", (shown) => parseFloat(shown.textContent) || -1);

async function open(browser, server, view, query) {
  const page = await browser.newPage();
  await page.setViewport(view);
  page.on("pageerror", (error) => console.error(error.message));
  await page.goto(`${server.address}?${query}`);
  await page.bringToFront();
  await until("the page is connected", () => page.evaluate(() => globalThis.tether?.connection.isOpen));
  return page;
}

const set = (page, name, value) =>
  page.evaluate(
    (key, now) => {
      globalThis.tether.connection.setParameters([{ name: key, value: now }]);
    },
    name,
    value,
  );

/** One log's frames: a picture each half second of the run while it plays. */
async function film(name) {
  const browser = await launch();
  const server = await serve(tether, "view", path.join(work, name, "run.lcmlog"), "--port", "0");
  const page = await open(browser, server, { width: 420, height: 560 }, "poster&theme=light");
  await set(page, "playback.playing", false);
  await set(page, "playback.position_s", 0);
  await set(page, "playback.playing", true);
  for (let i = 0; i * STEP_S < END_S; ++i) {
    await until(`${i * STEP_S} s`, async () => {
      const now_s = await runTime(page);
      return now_s >= i * STEP_S && now_s < i * STEP_S + 5;
    });
    await page.screenshot({
      path: path.join(work, "frames", `${name}-${String(i).padStart(3, "0")}.png`),
      optimizeForSpeed: true,
    });
  }
  await browser.close();
  await server.end();
}

/** Still pictures of one log, played from `from_s` to `at_s`. */
async function still(name, file, view, query, from_s, at_s) {
  const browser = await launch();
  const server = await serve(tether, "view", path.join(work, name, "run.lcmlog"), "--port", "0");
  const page = await open(browser, server, view, query);
  await set(page, "playback.position_s", from_s);
  await set(page, "playback.playing", true);
  await until("the moment", async () => Math.abs((await runTime(page)) - at_s) < 0.5, 60);
  await page.screenshot({ path: path.join(out, file) });
  await browser.close();
  await server.end();
}

/** A run that is computed, with what can be set, after half a minute of it. */
async function computed(file, view, query, ...run) {
  const browser = await launch();
  const server = await serve(tether, "run", ...run, "--view", "--port", "0");
  const page = await open(browser, server, view, query);
  await until("half a minute", async () => (await runTime(page)) > 32, 90);
  await page.screenshot({ path: path.join(out, file), fullPage: file === "view-page.png" });
  await browser.close();
  await server.end();
}

/** On a network that changes between good and bad. */
const CHANGING = [
  "sensor.rate_hz=10",
  "channel.model=markov",
  "channel.markov.bad.delay_ms=600",
  "channel.markov.mean_good_s=6",
  "channel.markov.mean_bad_s=4",
  "run.duration_s=600",
].flatMap((setting) => ["--set", setting]);
const FLEET = "scenarios/warehouse_fleet.toml";

fs.mkdirSync(path.join(work, "frames"), { recursive: true });
await film("pid");
await film("predictive");
await still("predictive", "view-stage.png", { width: 1280, height: 800 }, "stage&theme=dark", 14, 30);
await still(
  "predictive",
  "view-phone.png",
  { width: 390, height: 844, isMobile: true, hasTouch: true },
  "theme=dark",
  14,
  26,
);
await computed("view-page.png", LAPTOP, "theme=light", scenario, ...CHANGING);
await computed("view-fleet.png", LAPTOP, "theme=light", FLEET, "--speed", "4");
await sleep(100);
