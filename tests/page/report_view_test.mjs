// node report_view_test.mjs TETHER WORK: reports as people use them. WORK has out/, a report of the sweeps "two
// words" and "waypoints", the latter without its file of waypoints, and runs.json, the runs of the former.
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import fs from "node:fs";
import path from "node:path";
import { after, before, test as testOf } from "node:test";
import { launch, serve, sleep, until } from "./browser.mjs";

const [tether, work] = process.argv.slice(2);
const folder = path.join(work, "out");
const RUNS = JSON.parse(fs.readFileSync(path.join(work, "runs.json"), "utf8"));
const worst = RUNS.filter(([arm]) => arm === 0).sort((a, b) => b[2] - a[2])[0]; // of the first point
const test = (fact, check) => testOf(fact, { timeout: 60_000 }, check);
let browser;

before(async () => (browser = await launch()));
after(() => browser.close());

/** What goes wrong on a page, or is asked for elsewhere. */
function watch(page, address) {
  const wrong = [];
  page.on("pageerror", (error) => wrong.push(error.message));
  page.on("console", (message) => message.type() === "error" && wrong.push(message.text()));
  page.on("request", (request) => {
    const url = request.url();
    if (!url.startsWith(address) && !/^(data|blob):/.test(url)) wrong.push(`asks for ${url}`);
  });
  return wrong;
}

/** Runs `act(page)` on the report, with all of its charts open. */
async function onReport(address, act, view = { width: 1200, height: 900 }) {
  const page = await browser.newPage();
  const wrong = watch(page, new URL("/", address).href);
  try {
    await page.setViewport(view);
    await page.goto(address);
    for (const summary of await page.$$("details.chart summary")) await summary.click();
    await until("charts", () => page.$$eval("canvas", (all) => all.length === 2 && all.every(Chart.getChart)));
    await act(page);
    assert.deepEqual(wrong, []);
  } finally {
    await page.close();
  }
}

async function onServedReport(act, ...more) {
  const server = await serve(tether, "view", folder, "--port", "0", ...more);
  try {
    await onReport(server.address, (page) => act(page, server));
  } finally {
    await server.end();
  }
}

/** Clicks at the first point of a chart. */
async function clickPoint(page, chart) {
  const canvas = (await page.$$("canvas"))[chart];
  await canvas.scrollIntoView();
  const place = () =>
    canvas.evaluate((one) => {
      const { left, top } = one.getBoundingClientRect();
      const { x, y } = Chart.getChart(one).getDatasetMeta(0).data[0];
      return [left + x, top + y];
    });
  let [x, y] = await place();
  await until("the page stands still", async () => {
    await sleep(100);
    const [xBefore, yBefore] = [x, y];
    [x, y] = await place();
    return x === xBefore && y === yBefore;
  });
  await page.mouse.click(x, y);
}

/** The tab that `act` opens at an address that ends so. */
async function opened(ending, act) {
  await act();
  const target = await browser.waitForTarget((one) => decodeURI(one.url()).endsWith(ending), { timeout: 10_000 });
  return target.page();
}

const vehicle = (page) => page.evaluate(() => globalThis.tether?.model.shown?.place ?? null);

/** The run's ε at its end, and as the page writes it. */
async function epsilonAtEnd(page) {
  await until("the vehicle", () => vehicle(page).catch(() => null)); // it was another page until then
  await page.focus("#scrub");
  await page.keyboard.press("End");
  await until("the end", () => page.evaluate(() => globalThis.tether.model.shown.truth.utime >= 20e6));
  const exact = await page.evaluate(() => globalThis.tether.model.shown.truth.epsilon_m);
  await until("the number", async () => Math.abs((await page.$eval("#n-epsilon", (one) => Number(one.textContent))) - exact) < 0.006);
  return exact;
}

test("a click at a point opens its worst run in the viewer, with the ε that the sweep has", () =>
  onServedReport(async (page, server) => {
    const run = await opened(`/runs/two words/0/${worst[1]}`, () => clickPoint(page, 0));
    const wrong = watch(run, server.address);
    assert.equal(await epsilonAtEnd(run), worst[2]);
    assert.match(await run.$eval("#source", (one) => one.textContent), new RegExp(`prr-arm0-seed${worst[1]}`));
    await run.focus("#scrub");
    await run.keyboard.press("Home");
    await until("it can be scrubbed", () => run.evaluate(() => globalThis.tether.model.shown.truth.utime < 2e6));
    assert.deepEqual(wrong, []);
    await run.close();
  }));

test("without a mouse a point is chosen from a list, and each of its runs opens by a link", () =>
  onServedReport(async (page) => {
    const [arm, seed, epsilon_m] = RUNS.find(([one, other]) => one === 1 && other === 2);
    await page.focus(".points select");
    await page.keyboard.press("End"); // the last point: PRR 1
    await until("its runs", () => page.$(".runs select"));
    await page.select(".runs select", `${seed}`);
    const run = await opened(`/runs/two words/${arm}/${seed}`, async () => {
      await page.focus(".runs a");
      await page.keyboard.press("Enter");
    });
    assert.equal(await epsilonAtEnd(run), epsilon_m);
    await run.close();
  }));

test("a run that cannot be made again says why", () =>
  onServedReport(async (page) => {
    const [, list] = await page.$$(".points select");
    await list.select("0 0");
    await page.select(".runs select", "1");
    const run = await opened("/runs/waypoints/0/1", () => page.click(".runs a"));
    const said = await until("the reason", () =>
      run.$eval("#state", (one) => /cannot be made again/.test(one.textContent) && one.textContent).catch(() => null),
    );
    assert.match(said, /arm 0, seed 1 of .*waypoints\/runs\.sqlite cannot be made again: .*waypoints\.csv.*tether /);
    assert.equal(await run.$eval("#share", (one) => one.hidden), true);
    await run.close();
  }));

test("with a token all of this is behind it", async () => {
  const token = "0123456789abcdef";
  await onServedReport(
    async (page, server) => {
      const open = new URL("/", server.address).href;
      const address = `${open}runs/two%20words/0/1`;
      for (const [url, method] of [[open, "GET"], [address, "GET"], [address, "POST"]]) {
        assert.equal((await fetch(url, { method })).status, 403, `${method} ${url}`);
      }
      const run = await opened(`/runs/two words/0/${worst[1]}`, () => clickPoint(page, 0));
      assert.equal(await epsilonAtEnd(run), worst[2]);
      await run.close();
    },
    "--token",
    token,
  );
});

test("no other page, file or run is to be had, and another site begins nothing", async () => {
  const server = await serve(tether, "view", folder, "--port", "0");
  const get = async (where, how = {}) => (await fetch(`${server.address}${where}`, how)).status;
  for (const where of ["runs", "runs/0/1", "runs/two%20words/0/99", "runs/two%20words/7/1", "runs/two%20words/0/1/",
    "runs/two%20words/0/-1", "runs/two%20words/0/1x", "runs/waypoints/..%2f..%2fprr.toml/0/1", "runs.sqlite",
    "two%20words/runs.sqlite", "%2e%2e/prr.toml", "index.html", "api/run.json"]) {
    assert.equal(await get(where), 404, where);
    assert.equal(await get(where, { method: "POST" }), 404, where);
  }
  assert.equal(await get("runs/two%20words/0/1", { method: "POST", headers: { Origin: "http://evil.example" } }), 403);
  assert.equal(await get("runs/two%20words/0/1", { method: "DELETE" }), 405);
  assert.equal(await get("", { method: "POST" }), 405);
  await server.end();
});

test("opened as a file, a point says by which command it can be opened", () =>
  onReport(`file://${folder}/report.html`, async (page) => {
    const tabs = (await browser.pages()).length;
    await clickPoint(page, 0);
    await page.waitForSelector(".runs pre");
    const commands = (await page.$eval(".runs pre", (one) => one.textContent)).split("\n");
    assert.equal(commands.length, 3);
    assert.match(commands[2], /^tether view '.*\/out'/);
    assert.equal(await page.$(".runs a"), null);
    assert.equal((await browser.pages()).length, tabs, "no tab opens");
    execFileSync("sh", ["-c", `${commands[0].replace("tether", `'${tether}'`)}`], { cwd: work });
    assert.match(fs.readFileSync(path.join(work, "again.toml"), "utf8"), new RegExp(`seed = ${worst[1]}\\b`));
  }));

for (const scheme of ["light", "dark"]) {
  test(`its colours are as the system has them, ${scheme}, and on a phone nothing is wider than the screen`, () =>
    onReport(`file://${folder}/report.html`, async (page) => {
      await page.emulateMediaFeatures([{ name: "prefers-color-scheme", value: scheme }]);
      const brightness = () =>
        page.evaluate(() => {
          const of = (colour) => colour.match(/\d+/g).slice(0, 3).reduce((sum, one) => sum + Number(one), 0) / 3;
          const { backgroundColor, color } = getComputedStyle(document.body);
          const ticks = Chart.getChart(document.querySelector("canvas")).options.scales.x.ticks.color;
          return [of(backgroundColor), of(color), of(ticks)];
        });
      const [paper, ink, ticks] = await until("the chart is drawn again", async () => {
        const all = await brightness();
        return Math.abs(all[1] - all[2]) < 1 ? all : null;
      });
      assert.ok(scheme === "light" ? paper > 240 && ink < 60 : paper < 60 && ink > 200, `${paper} ${ink} ${ticks}`);
      await clickPoint(page, 0);
      assert.ok(await page.evaluate(() => document.scrollingElement.scrollWidth <= innerWidth));
    }, { width: 390, height: 844, isMobile: true, hasTouch: true }));
}
