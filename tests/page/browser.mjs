// Chromium and `tether`, for tests and pictures of the page.
import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { createInterface } from "node:readline";
import puppeteer from "puppeteer-core";

export const sleep = (ms) => new Promise((resolve) => setTimeout(resolve, ms));

export const LAPTOP = { width: 1440, height: 900 };

export function launch() {
  return puppeteer.launch({
    executablePath: "/usr/bin/chromium",
    args: ["--no-sandbox", "--disable-dev-shm-usage"],
  });
}

/** Starts `tether ...` with a view; resolves to {address, end()} when it says where that is. */
export function serve(tether, ...args) {
  const child = spawn(tether, args, { stdio: ["ignore", "ignore", "pipe"] });
  const said = [];
  return new Promise((resolve, reject) => {
    createInterface({ input: child.stderr }).on("line", (line) => {
      said.push(line);
      const found = /view at (http:\S+)/.exec(line);
      if (found) resolve({ address: found[1], end: () => end(child) });
    });
    child.on("exit", (code) =>
      reject(new Error(`tether ${args.join(" ")} ended with ${code}: ${said.join("\n")}`)),
    );
  });
}

function end(child) {
  return new Promise((resolve) => {
    if (child.exitCode !== null || child.signalCode !== null) return resolve();
    child.on("exit", resolve);
    child.kill("SIGTERM");
    setTimeout(() => child.kill("SIGKILL"), 3000).unref();
  });
}

/** Polls until `condition()` is true, and returns what it gave. */
export async function until(what, condition, seconds = 20) {
  const deadline = Date.now() + seconds * 1000;
  for (;;) {
    const result = await condition();
    if (result) return result;
    if (Date.now() > deadline) throw new Error(`not within ${seconds} s: ${what}`);
    await sleep(50);
  }
}

/** Runs `act(page, server)` on a page of what `command` serves; no error of the page, nothing from elsewhere. */
export async function onPageOf(browser, command, act, view = LAPTOP, mayFail = false) {
  const server = await serve(...command);
  const page = await browser.newPage();
  const errors = [];
  page.on("pageerror", (error) => errors.push(error.message));
  page.on("console", (message) => message.type() === "error" && !mayFail && errors.push(message.text()));
  page.on("request", (request) => {
    if (!request.url().startsWith(server.address) && !request.url().startsWith("data:"))
      errors.push(`asks for ${request.url()}`);
  });
  try {
    await page.setViewport(view);
    await page.goto(server.address);
    await until("the page is connected", () => page.evaluate(() => globalThis.tether?.connection.isOpen));
    await act(page, server);
    assert.deepEqual(errors, []);
  } finally {
    await page.close();
    await server.end();
  }
}
