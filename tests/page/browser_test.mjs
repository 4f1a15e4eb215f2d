// node browser_test.mjs TETHER SCENARIO WORK: the page as people use it. WORK has run/, a run's folder, and
// fleet.lcmlog. Each fact is a test; they run one after the other, in one browser.
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import fs from "node:fs";
import path from "node:path";
import { after, before, test as testOf } from "node:test";
import { LAPTOP, launch, onPageOf, serve, sleep, until } from "./browser.mjs";
import { cpuOfRenderers } from "./cpu_time.mjs";

const [tether, scenario, work] = process.argv.slice(2);
const PHONE = { width: 390, height: 844, isMobile: true, hasTouch: true, deviceScaleFactor: 2 };
const test = (fact, check) => testOf(fact, { timeout: 60_000 }, check);
let browser;

before(async () => (browser = await launch()));
after(() => browser.close());

const onPage = (args, act, view = LAPTOP, mayFail = false) => onPageOf(browser, [tether, ...args], act, view, mayFail);

const run = (...more) => [
  "run",
  scenario,
  "--set",
  "vehicle.plant=kinematic",
  "--set",
  "sensor.rate_hz=20",
  "--set",
  "run.duration_s=1000",
  ...more,
  "--view",
  "--port",
  "0",
];
const log = (name) => ["view", path.join(work, name), "--port", "0"];
const text = (page, id) => page.$eval(`#${id}`, (element) => element.value ?? element.textContent);

/** Clicks a slider at a share of its length. */
async function slide(page, selector, share) {
  const slider = await page.waitForSelector(selector);
  await slider.scrollIntoView();
  const box = await slider.boundingBox();
  await page.mouse.click(box.x + 8 + share * (box.width - 16), box.y + box.height / 2);
}

/** How many pixels of the vehicle's colour are on the map around a place, in pixels of the map; of none, the vehicle's. */
function bluePixels(page, place) {
  return page.evaluate(
    (place) => {
      const { map, model } = globalThis.tether;
      const at = model.shown?.place;
      if (!place && !at) return 0;
      const [px, py] = place ?? [map.camera.x(at.x_m), map.camera.y(at.y_m)];
      const wanted = getComputedStyle(document.documentElement).getPropertyValue("--truth").trim();
      const rgb = [1, 3, 5].map((i) => parseInt(wanted.slice(i, i + 2), 16));
      const ratio = map.surface.ratio;
      const { data } = map.surface.context.getImageData(
        (px - 12) * ratio,
        (py - 12) * ratio,
        24 * ratio,
        24 * ratio,
      );
      let count = 0;
      for (let i = 0; i < data.length; i += 4) {
        if (rgb.every((value, c) => Math.abs(data[i + c] - value) < 6) && data[i + 3] > 250) ++count;
      }
      return count;
    },
    place,
  );
}

const vehicleOnMap = (page) =>
  page.evaluate(() => {
    const { map, model } = globalThis.tether;
    const place = model.shown?.place;
    return place ? [map.camera.x(place.x_m), map.camera.y(place.y_m)] : null;
  });

test("the vehicle is seen to move", () =>
  onPage(run("--speed", "2"), async (page) => {
    const first = await until("a vehicle", () => vehicleOnMap(page));
    await until("it is drawn", async () => (await bluePixels(page)) > 60);
    await until("it has moved by 60 pixels", async () => {
      const [x, y] = await vehicleOnMap(page);
      return Math.hypot(x - first[0], y - first[1]) > 60;
    });
    await until("it is drawn where it is", async () => (await bluePixels(page)) > 60);
    await until("and no more where it was", async () => (await bluePixels(page, first)) < 60);
  }));

test("of a fleet one is looked at, by the numbers, its law and its path", () =>
  onPage(
    run(..."fleet.count=3 fleet.vehicle.2.controller.law=tracking fleet.vehicle.2.path.amplitude_m=9"
      .split(" ").flatMap((setting) => ["--set", setting]), "--speed", "2"),
    async (page) => {
      await until("three to choose from", () => page.$$eval("#vehicle option", (all) => all.length === 3));
      assert.equal(await page.$eval("#vehicle", (choice) => choice.value), "1");
      await until("whose the settings are", async () =>
        /of all vehicles' links; shown is what AGV1 has/.test(await text(page, "settings-whose")),
      );
      await until("facts", async () => /law.*uplink/.test(await text(page, "facts")));
      const seen = async () => [
        /law(.*?)uplink/.exec(await text(page, "facts"))[1],
        await page.evaluate(() => Math.max(...globalThis.tether.map.scene.path.map(([x]) => x)) > 12),
      ];
      assert.deepEqual(await seen(), ["pid", true]);
      await page.select("#vehicle", "2");
      await until("its own path", async () => !(await seen())[1]);
      assert.deepEqual(await seen(), ["tracking", false]);
      await until("it is drawn", async () => (await bluePixels(page)) > 60);
    },
  ));

test("a slider changes the PRR in the relay", () =>
  onPage(run("--speed", "10"), async (page) => {
    await until("settings", () => page.$eval("#controls", (panel) => !panel.hidden));
    await slide(page, '.setting[data-name="network.uplink.prr"] input[type=range]', 0.2);
    const prr = await until("the relay's answer", () =>
      page.evaluate(() => {
        const { parameters } = globalThis.tether.model;
        const value = parameters.get("network.uplink.prr");
        return value < 1 && value === parameters.get("network.downlink.prr") ? value : 0;
      }),
    );
    assert.ok(Math.abs(prr - 0.2) < 0.03, `${prr}`);
    const counts = () =>
      page.evaluate(() => {
        const { offered, delivered } = globalThis.tether.model.links.uplink;
        return [offered, delivered];
      });
    await sleep(500);
    const before = await counts();
    const now = await until(
      "a thousand packets",
      async () => {
        const later = await counts();
        return later[0] - before[0] >= 1000 ? later : null;
      },
      40,
    );
    const n = now[0] - before[0];
    const share = (now[1] - before[1]) / n;
    const deviation = Math.sqrt((prr * (1 - prr)) / n);
    assert.ok(Math.abs(share - prr) < 5 * deviation, `${share} of ${n} got through`);
  }));

test("a choice that needs another setting brings it along", () =>
  onPage(run(), async (page) => {
    await page.waitForSelector('.setting[data-name="network.uplink.jitter.law"] select');
    await page.select('.setting[data-name="network.uplink.jitter.law"] select', "normal");
    await until("the relay has it", () =>
      page.evaluate(() => globalThis.tether.model.parameters.get("network.uplink.jitter.law") === "normal"),
    );
  }));

test("what the relay refuses is said, and the page shows what is in force", () =>
  onPage(run(), async (page) => {
    const field = await page.waitForSelector(
      '.setting[data-name="network.uplink.delay_ms"] input[type=number]',
    );
    await field.click({ clickCount: 3 });
    await field.type("-5");
    await page.keyboard.press("Enter");
    await until("the refusal", async () => /delay_ms/.test(await text(page, "answer")));
    await page.focus("#map");
    await until("the value in force", () => field.evaluate((input) => input.value === "0"));
  }));

test("a log is scrubbed: the page shows the vehicle where it was then", () =>
  onPage(log("run/run.lcmlog"), async (page) => {
    const rows = fs
      .readFileSync(path.join(work, "run/trajectory.csv"), "utf8")
      .trim()
      .split("\n")
      .slice(1)
      .map((row) => row.split(",").map(Number));
    for (const share of [0.75, 0.25, 0.5]) {
      await slide(page, "#scrub", share);
      const seen = await until(`${share} of the log`, () =>
        page.evaluate((wanted) => {
          const { model } = globalThis.tether;
          const truth = model.shown?.truth;
          return truth && Math.abs(truth.utime / 1e6 - wanted) < 1 ? truth : null;
        }, share * 40),
      );
      const row = rows.find(([t]) => Math.abs(t - seen.utime / 1e6) < 1e-3);
      assert.ok(Math.hypot(seen.x_m - row[1], seen.y_m - row[2]) < 1e-4, "it is where trajectory.csv has it");
    }
    assert.equal(
      await page.$eval("#controls", (panel) => panel.hidden),
      true,
      "a log's network cannot be set",
    );
  }));

test("a log in one file is replayed and scrubbed, from file:// and offline", async () => {
  const out = path.join(work, "run.html");
  execFileSync(tether, ["log", "page", path.join(work, "run/run.lcmlog"), "--out", out]);
  const page = await browser.newPage();
  const wrong = [];
  page.on("pageerror", (error) => wrong.push(error.message));
  page.on("console", (message) => message.type() === "error" && wrong.push(message.text()));
  page.on("request", (request) => /^(file|data):/.test(request.url()) || wrong.push(`asks for ${request.url()}`));
  await page.setViewport(LAPTOP);
  await page.setOfflineMode(true);
  await page.goto(`file://${out}`);
  const first = await until("a vehicle", () => vehicleOnMap(page).catch(() => null));
  await until("it has moved by 30 pixels", async () => {
    const [x, y] = await vehicleOnMap(page);
    return Math.hypot(x - first[0], y - first[1]) > 30;
  });
  for (const share of [0.75, 0.25]) {
    await slide(page, "#scrub", share);
    await until(`${share} of the log`, () => page.evaluate((wanted) => {
      const truth = globalThis.tether.model.shown?.truth;
      return truth && Math.abs(truth.utime / 1e6 - wanted) < 1.5;
    }, share * 40));
  }
  await until("it is drawn", async () => (await bluePixels(page)) > 60);
  assert.match(await text(page, "source"), /log run\.lcmlog/);
  assert.equal(await page.evaluate(() => globalThis.tether.model.about.half_extent_m > 0), true, "walls are known");
  assert.deepEqual(wrong, []);
  await page.close();
});

test("a log plays: the age of information is at least the uplink's delay", () =>
  onPage(log("run/run.lcmlog"), async (page) => {
    const isPlaying = () => page.evaluate(() => globalThis.tether.model.parameters.get("playback.playing"));
    await page.click("#play"); // it plays from the start
    await until("it stands", async () => (await isPlaying()) === false);
    await page.click("#play");
    await until("it plays", async () => (await isPlaying()) === true);
    await until("ages", async () => Number(await text(page, "n-age")) >= 0.1);
    await until("ways of poses", () =>
      page.evaluate(() => {
        const way = globalThis.tether.model.shown.uplink.packets.filter((packet) => packet.arrived_s > 0);
        return (
          way.length > 10 && way.every((packet) => Math.abs(packet.arrived_s - packet.sent_s - 0.1) < 0.002)
        );
      }),
    );
  }));

test("the table has each channel's rate, and a message's fields", () =>
  onPage(run(), async (page) => {
    await page.click("#table-panel summary");
    const rate = () =>
      page.$$eval("#table tbody tr", (rows) => {
        const row = rows.find((one) => one.dataset.topic === "AGV/POSE");
        return row ? Number(row.cells[3].textContent) : NaN;
      });
    await until("20 poses per second", async () => Math.abs((await rate()) - 20) < 0.5);
    await page.click('#table tr[data-topic="AGV/POSE"]');
    await until("its fields", () =>
      page.$$eval("#message tbody tr", (rows) => rows.some((row) => row.cells[0].textContent === "yaw_rad")),
    );
  }));

test("a server that ends is noticed, and found again when it comes back", async () => {
  let again;
  try {
    await onPage(
      run(),
      async (page, server) => {
        await server.end();
        await until("the page says so", async () => (await text(page, "connection")) !== "connected");
        assert.equal(await page.$eval("#banner", (banner) => banner.hidden), false);
        const port = new URL(server.address).port;
        again = await serve(tether, ...run().slice(0, -1), port);
        await until("it is connected again", async () => (await text(page, "connection")) === "connected");
      },
      LAPTOP,
      true,
    );
  } finally {
    await again?.end();
  }
});

for (const theme of ["light", "dark"]) {
  test(`on a phone nothing is wider than the screen, ${theme}`, () =>
    onPage(
      run(),
      async (page) => {
        await page.goto(`${page.url()}?theme=${theme}`);
        await until("a vehicle", () => vehicleOnMap(page).catch(() => null));
        await until("settings", () => page.$eval("#controls", (panel) => !panel.hidden));
        assert.ok(await page.evaluate(() => document.scrollingElement.scrollWidth <= innerWidth));
        const order = await page.evaluate(() =>
          ["numbers", "map-panel", "controls", "plots"].map(
            (id) => document.getElementById(id).getBoundingClientRect().top,
          ),
        );
        assert.ok(order.every((top) => Number.isFinite(top)));
        assert.deepEqual(
          order,
          order.slice().sort((a, b) => a - b),
          "verdict, map, settings, plots",
        );
      },
      PHONE,
    ));
}

test("the e-stop button stops the drives, and a release and a reset let them be armed again", () =>
  onPage(
    [
      "run",
      path.join(path.dirname(scenario), "hil_vcan.toml"),
      "--set",
      "run.duration_s=1000",
      "--speed",
      "2",
      "--view",
      "--port",
      "0",
    ],
    async (page) => {
      const state = (wanted) => until(wanted, async () => (await text(page, "can-state")) === wanted);
      await state("ARMED");
      const speed = () => page.evaluate(() => globalThis.tether.model.shown.truth?.v_mps);
      await until("it drives", async () => (await speed()) > 0.5);
      await page.click("#estop");
      await state("ESTOP");
      await until("it stands", async () => Math.abs(await speed()) < 0.01);
      await page.click("#release");
      await page.click("#reset");
      await state("DISARMED");
    },
  ));

test("a browser that is too old gets a message", async () => {
  const server = await serve(tether, ...run());
  const page = await browser.newPage();
  await page.evaluateOnNewDocument(() => delete globalThis.ResizeObserver);
  await page.goto(server.address);
  const note = await until("the note", () =>
    page.$eval("#too-old", (element) => !element.hidden && element.textContent),
  );
  assert.match(note, /needs Chrome or Edge \d+, Firefox \d+, Safari/);
  await page.close();
  await server.end();
});

test("the vehicle is driven by keys only while the dead man is held", () =>
  onPage(run(), async (page) => {
    await until("what the server offers", () => page.evaluate(() => globalThis.tether.model.about !== null));
    await page.evaluate(() => {
      // same as on a server that lets the page drive
      globalThis.tether.sent = [];
      globalThis.tether.connection.publish = (topic, schema, fields) => globalThis.tether.sent.push(fields);
      document.getElementById("drive").hidden = false;
    });
    const sent = () => page.evaluate(() => globalThis.tether.sent.splice(0));
    await page.keyboard.down("KeyW");
    await sleep(300);
    assert.deepEqual(await sent(), []);
    await page.keyboard.up("KeyW");
    await page.keyboard.down("Space");
    await page.keyboard.down("KeyW");
    await until("twists", () => page.evaluate(() => globalThis.tether.sent.length > 3));
    assert.deepEqual((await sent()).at(-1), { v_mps: 1, omega_radps: 0 });
    await page.evaluate(() => dispatchEvent(new Event("blur"))); // another window: the hand counts as gone
    await until("a stop", async () => (await sent()).some(({ v_mps }) => v_mps === 0));
    await sleep(1500);
    assert.deepEqual(
      await page.evaluate(() => globalThis.tether.sent.slice(-1)[0] ?? { v_mps: 0, omega_radps: 0 }),
      { v_mps: 0, omega_radps: 0 },
    );
    await sent();
    await sleep(300);
    assert.deepEqual(await sent(), [], "then nothing is sent");
  }));

// The time of a picture is a figure for docs/howto/view.md. A busy machine plays and draws less: what comes is compared
// with what the server has played, and pictures are counted per second of the log.
test("100 vehicles at 50 Hz: all messages come, and pictures are drawn", () =>
  onPage(log("fleet.lcmlog"), async (page) => {
    await (await page.createCDPSession()).send("Network.disable");
    await page._client().send("Network.disable"); // else each message is reported to the test, too
    await until("100 vehicles", () => page.evaluate(() => globalThis.tether.model.vehicles.size === 100));
    const counts = () =>
      page.evaluate(async () => {
        const { model, frames } = globalThis.tether;
        const status = await (await fetch("/api/status.json")).json();
        return {
          frames: frames.total,
          came: [...model.channels.values()].reduce((sum, channel) => sum + channel.count, 0),
          played: status["messages.heard"] - status["messages.dropped_for_slow_clients"],
          log_s: model.channels.get("AGV1/POSE").latest.utime / 1e6,
        };
      });
    const paused = async () => {
      await page.click("#play");
      let before = await counts();
      return until("nothing comes any more", async () => {
        await sleep(300);
        const now = await counts();
        const rests = now.played === before.played && now.came === before.came;
        before = now;
        return rests && now;
      });
    };
    const first = await paused();
    await page.click("#play");
    const cpu1_s = cpuOfRenderers(browser.process().pid);
    await sleep(6000);
    const cpu_s = cpuOfRenderers(browser.process().pid) - cpu1_s;
    const last = await paused();
    const of = (count) => last[count] - first[count];
    console.log(
      `in ${of("log_s").toFixed(1)} s of the log ${of("frames")} pictures, ` +
        `${((1000 * cpu_s) / of("frames")).toFixed(1)} ms of computing each, ${of("came")} messages`,
    );
    assert.ok(of("log_s") > 0, "the log plays");
    assert.ok(of("played") > 100 * of("log_s"), "messages of all vehicles");
    assert.equal(of("came"), of("played"), "all messages that were played came");
    assert.ok(of("frames") > 2 * of("log_s"), "pictures are drawn");
  }));
