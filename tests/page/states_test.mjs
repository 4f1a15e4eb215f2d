// node states_test.mjs TETHER SCENARIO LCM_URL LOG HALL HOSTILE: what the page says when there is nothing new, a run has ended, or
// no relay runs. In a network of its own: on it there is what the tests start.
import assert from "node:assert/strict";
import { execFileSync, spawn } from "node:child_process";
import path from "node:path";
import { after, before, test as testOf } from "node:test";
import { launch, onPageOf, until } from "./browser.mjs";

const [tether, scenario, url, log, hall, hostile] = process.argv.slice(2);
const test = (fact, check) => testOf(fact, { timeout: 60_000 }, check);
let browser;

before(async () => (browser = await launch()));
after(() => browser.close());

const onPage = (args, act, mayFail = false) => onPageOf(browser, [tether, ...args, "--port", "0"], act, undefined, mayFail);
const run = (...more) => ["run", scenario, "--set", "vehicle.plant=kinematic", ...more, "--view"];
const text = (page, id) => page.$eval(`#${id}`, (element) => element.value ?? element.textContent);
const verdict = (page) => text(page, "verdict-text");

/** A vehicle alone on the network; killed when `act` is done. */
async function withVehicle(act) {
  const sim = spawn(path.join(path.dirname(tether), "tether-sim"), [scenario, "--lcm-url", url], { stdio: "ignore" });
  try {
    await act(sim);
  } finally {
    sim.kill("SIGKILL");
  }
}

test("of a run that is being computed the time cannot be set, its pace can, and it says why", () =>
  onPage(run("--set", "run.duration_s=1000"), async (page) => {
    await until("the bar", () => page.$eval("#playback", (bar) => !bar.hidden));
    await until("it cannot be scrubbed", () => page.$eval("#scrub", (bar) => bar.disabled));
    assert.match(await page.$eval("#scrub", (bar) => bar.title), /is being computed: its time cannot be set/);
    await page.keyboard.press("ArrowRight"); // a second forward, in a log
    await page.select("#speed", "10");
    await until("its pace", () => page.evaluate(() => globalThis.tether.model.parameters.get("playback.speed") === 10));
    await page.keyboard.press("Space");
    await until("it stands", () => page.evaluate(() => globalThis.tether.model.parameters.get("playback.playing") === false));
    assert.notEqual(await verdict(page), "RUN ENDED");
    assert.doesNotMatch(await text(page, "answer"), /cannot be set/, "nothing was asked that is refused");
  }));

/** [x, y] of all within 10 cm of an outline, from those that are given. */
const offOutlines = (points, outlines) =>
  points.filter(([x, y]) =>
    !outlines.some((outline) =>
      outline.some(([ax, ay], i) => {
        const [bx, by] = outline[(i + 1) % outline.length];
        const [dx, dy] = [bx - ax, by - ay];
        const share = Math.min(1, Math.max(0, ((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy)));
        return Math.hypot(x - ax - share * dx, y - ay - share * dy) < 0.1;
      }),
    ),
  );

test("the beams of a scan end at walls, obstacles, and what moves", () =>
  onPage(["run", hall, "--set", "channel.prr=0", "--view"], async (page) => { // who stands sees the same, however late
    await until("two scans", () => page.evaluate(() => globalThis.tether.model.channels.get("AGV/SCAN")?.count > 10));
    await page.click("#play");
    await until("it stands", () => page.evaluate(() => globalThis.tether.model.parameters.get("playback.playing") === false));
    const { points, outlines, moving, scanned_s } = await page.evaluate(() => {
      const { model, map } = globalThis.tether;
      const flat = model.shown.points;
      return {
        points: flat.filter((_, i) => i % 2 === 0).map((x, i) => [x, flat[2 * i + 1]]),
        outlines: [...map.scene.walls, ...map.scene.obstacles],
        moving: map.scene.moving,
        scanned_s: model.channels.get("AGV/SCAN").latest.utime / 1e6,
      };
    });
    assert.ok(points.length > 100, `${points.length} beams`);
    assert.equal(outlines.length, 2, "the walls, and the pillar");
    const [{ outline, places }] = moving;
    const [, x, y] = places.filter(([t]) => t <= scanned_s).at(-1); // it pauses for long
    const all = [...outlines, outline.map(([dx, dy]) => [x + dx, y + dy])];
    const off = offOutlines(points, all);
    assert.ok(off.length <= 0.03 * points.length, `${off.length} of ${points.length} beams end in the air: ${off}`);
    const onMoving = offOutlines(points, outlines).length - off.length;
    const onPillar = offOutlines(points, [all[0], all[2]]).length - off.length;
    assert.ok(onMoving > 0 && onPillar > 0, `${onMoving} beams on what moves, ${onPillar} on the pillar`);
    assert.match(await text(page, "legend"), /laser scan.*moves by itself/);
  }));

test("how sure a localiser is stands beside how right it is, and who drives in a word", () =>
  onPage(run("--set", "run.duration_s=1000"), async (page) => {
    await until("a vehicle", () => page.evaluate(() => globalThis.tether.model.shown?.truth));
    assert.deepEqual(await page.$$eval("#localisation, #driver", (all) => all.map((one) => one.hidden)), [true, true]);
    await page.evaluate(() => {
      const { model } = globalThis.tether;
      const { truth } = model.shown;
      const hear = (topic, fields) =>
        model.hear({ topic, schema: "", bytes: 1, time_s: truth.utime / 1e6, fields: { utime: truth.utime, ...fields } }, 0);
      hear("AGV/LOCALISATION", { state: 1, x_m: truth.x_m + 0.03, y_m: truth.y_m - 0.04, yaw_rad: truth.yaw_rad,
        cov_x_x_m2: 4e-4, cov_x_y_m2: 0, cov_y_y_m2: 9e-4 });
      hear("AGV/AUTONOMY", { state: 2, state_name: "remote requested", reason: "the way is blocked" });
    });
    await until("the error", async () => (await text(page, "l-error")) === "5.0");
    assert.equal(await text(page, "l-axis"), (100 * Math.sqrt(5.991464547) * 0.03).toFixed(1));
    assert.equal(await text(page, "l-share"), "100");
    assert.equal(await text(page, "l-state"), "tracking");
    assert.match(await text(page, "driver"), /driven by\s+REMOTE REQUESTED\s+the way is blocked/);
    assert.match(await text(page, "legend"), /localiser's place, 95 %/);
  }));

test("peers of the link are listed, and clocks that are apart are warned of", () =>
  onPage(run("--set", "run.duration_s=1000"), async (page) => {
    await until("a vehicle", () => page.evaluate(() => globalThis.tether.model.shown?.truth));
    assert.equal(await page.$eval("#link", (panel) => panel.hidden), true);
    await page.evaluate(() => {
      const report = { utime: 1.8e15, peer: "<b>AGV1", up: true, age_s: 0.1, offset_known: true, offset_min_ms: 61,
        offset_max_ms: 64, clocks_apart: true, path: ["wifi"], path_alive: [true] };
      globalThis.tether.model.hear({ topic: "LINK/REPORT", schema: "", bytes: 1, time_s: 0, fields: report }, 0);
    });
    await until("the peer", async () => /AGV1/.test(await text(page, "peers")));
    assert.equal(await text(page, "peers"), "<b>AGV1 up by wifi · CLOCKS APART: clock 61.0 to 64.0 ms ahead of ours");
    assert.equal(await page.$eval("#peers p", (line) => line.dataset.level), "warn");
  }));

test("a log's time can be set, and nothing says otherwise", () =>
  onPage(["view", log], async (page) => {
    await until("the bar", () => page.$eval("#playback", (bar) => !bar.hidden));
    assert.deepEqual(await page.$eval("#scrub", (bar) => [bar.disabled, bar.title]), [false, ""]);
  }));

test("the end of a run is shown with its ε, and silence is then expected", () =>
  onPage(
    run("--set", "run.duration_s=20", "--speed", "0.1"),
    async (page) => {
      await until("a vehicle", () => page.evaluate(() => globalThis.tether.model.shown?.place));
      await page.select("#speed", "20");
      await until("the end", async () => /The run has ended/.test(await text(page, "banner")));
      const epsilon_m = await page.evaluate(() => globalThis.tether.model.shown.truth.epsilon_m);
      assert.equal(await text(page, "banner"), `The run has ended, with ε = ${epsilon_m.toFixed(3)} m.`);
      await until("the verdict", async () => (await verdict(page)) === "RUN ENDED");
      assert.equal(await text(page, "connection"), "no connection");
    },
    true,
  ));

/** No text of the hostile log became an element or ran, and those that the page shows are there as they are. */
async function showsHostileTextsAsTexts(page) {
  await page.click("#table-panel summary");
  for (const place of ["#peers", "#table tbody"]) {
    await until(`texts in ${place}`, async () => {
      const shown = await page.$eval(place, (element) => element.textContent);
      return ["<!--<script>", "</script><script>", "<img src=x", "<b class=taken>", "<h1 class=taken>"].every((one) => shown.includes(one));
    });
  }
  assert.match(await text(page, "driver"), /</, "who drives");
  assert.deepEqual(
    await page.evaluate(() => ["taken" in globalThis, document.querySelectorAll(".taken, img[src=x]").length]),
    [false, 0],
  );
}

test("names and texts in a log that try to be HTML and scripts are shown as text", () =>
  onPage(["view", hostile], showsHostileTextsAsTexts));

test("so they are on a page of the log in one file", async () => {
  const file = path.join(path.dirname(hostile), "hostile.html");
  execFileSync(tether, ["log", "page", hostile, "--out", file]);
  const page = await browser.newPage();
  const errors = [];
  page.on("pageerror", (error) => errors.push(error.message));
  try {
    await page.goto(`file://${file}`);
    await showsHostileTextsAsTexts(page);
    assert.deepEqual(errors, []);
  } finally {
    await page.close();
  }
});

test("a network without a relay has none to be set, and says so", () =>
  withVehicle(() =>
    onPage(["view", "--lcm-url", url, "--scenario", scenario], async (page) => {
      await until("a vehicle", () => page.evaluate(() => globalThis.tether.model.shown?.truth));
      await until("that there is no relay", async () => /no relay heard/.test(await text(page, "facts")));
      assert.equal(await page.$eval("#controls", (panel) => panel.hidden), true, "settings of nothing");
    }),
  ));

test("a vehicle that falls silent is NO NEWS, for how long, in grey, until it is heard again", () =>
  withVehicle((sim) =>
    onPage(["view", "--lcm-url", url], async (page) => {
      await until("a vehicle", () => page.evaluate(() => globalThis.tether.model.shown?.truth));
      await until("no word of old news", async () => !/NO NEWS/.test(await verdict(page)));
      sim.kill("SIGSTOP");
      const said = await until("no news", async () => /^NO NEWS for (\d+\.\d) s$/.exec(await verdict(page)));
      assert.ok(Number(said[1]) >= 1.5, "not before 1.5 s");
      await until("it goes on counting", async () => Number(/for (\S+) s/.exec(await verdict(page))?.[1]) >= 3);
      assert.equal(await page.$eval("#numbers", (panel) => panel.dataset.old), "true", "old numbers are grey");
      assert.equal(await text(page, "connection"), "connected", "the server is there");
      sim.kill("SIGCONT");
      await until("news", async () => !/NO NEWS/.test(await verdict(page)));
      assert.equal(await page.$eval("#numbers", (panel) => panel.dataset.old), "false");
    }),
  ));
