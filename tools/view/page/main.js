// Puts the page together: messages change the model, pictures are drawn from it at the screen's own
// rate.

import { Connection } from "./model/connection.js";
import { Controls } from "./controls.js";
import { Drive } from "./drive.js";
import { EmbeddedSocket, recordingIn } from "./model/embedded.js";
import { Lanes } from "./drawing/lanes.js";
import { FactoryMap } from "./drawing/map.js";
import { LEGEND } from "./drawing/marks.js";
import { Model } from "./model/model.js";
import { showDriver, showDrivetrain, showFacts, showLocalisation, showNumbers, showPeers } from "./numbers.js";
import { ErrorPicture } from "./drawing/onboard.js";
import { PlaybackBar } from "./playback.js";
import { Plots } from "./drawing/plots.js";
import { ChannelTable } from "./table.js";
import { onTheme, startTheme } from "./drawing/theme.js";
import { ABOUT_ADDRESS, REQUEST_SCHEMA, TWIST_SCHEMA, isWanted, topicsOf } from "./model/topics.js";

const find = (id) => document.getElementById(id);
const options = new URLSearchParams(location.search);
startTheme(find("theme"), options.get("theme") ?? undefined);

const model = new Model();
const clock_s = () => performance.now() / 1000;
const address = `${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/${location.search}`;
const banner = find("banner");
const recording = recordingIn(document); // of a page that is one file with its log
recording?.catch((error) => tell(`The log in this file cannot be read: ${error.message}`));
const transport = recording ? { Socket: function () { return new EmbeddedSocket(recording); } } : {};

function tell(text) {
  banner.textContent = text;
  banner.hidden = !text;
}

function whyClosed() {
  if (!model.hasEnded) return `No connection to ${location.host}. Is "tether view" running? Trying again …`;
  const epsilon_m = model.shown?.truth?.epsilon_m;
  return `The run has ended${Number.isFinite(epsilon_m) ? `, with ε = ${epsilon_m.toFixed(3)} m` : ""}.`;
}

const connection = new Connection(
  address,
  {
    onState(state) {
      const words = { connecting: "connecting …", open: recording ? "recording" : "connected", closed: "no connection" };
      find("connection").dataset.state = state;
      find("connection").textContent = words[state];
      if (state !== "connecting") model.isCut = state === "closed";
      if (state === "closed") tell(whyClosed());
      if (state === "open") tell("");
    },
    onInfo(info) {
      if (model.session !== info.sessionId) model.restart(); // another server: another run
      model.session = info.sessionId;
      document.title = info.name ?? "Tether";
      askAbout();
    },
    onMessage: (message) => model.hear(message, clock_s()),
    onParameters(parameters) {
      for (const { name, value } of parameters) model.parameters.set(name, value);
      playback.update(model.parameters);
      if (parameters.some(({ name }) => name.startsWith("network."))) showFacts(find("facts"), model);
      controls.update(model.parameters);
    },
    onStatus({ level, message }) {
      controls.say(message, level >= 1 ? "bad" : "none");
    },
  },
  { wants: isWanted, ...transport },
);

let topics = {}; // on which the page may publish

async function fetchAbout() {
  const answer = await fetch(ABOUT_ADDRESS + location.search);
  if (!answer.ok) throw new Error(`${answer.status} ${answer.statusText}`);
  return answer.json();
}

async function askAbout() {
  try {
    const about = recording ? (await recording).header.about : await fetchAbout();
    model.hearAbout(about);
    showFacts(find("facts"), model);
    controls.describe(about.parameters ?? []);
    playback.describe(about.parameters ?? []);
    topics = topicsOf(about.publishable ?? []);
    find("drive").hidden = !topics.twist;
    find("drive-whom").textContent = model.isFleet ? about.vehicle : "";
    find("settings-whose").hidden = !model.isFleet;
    find("settings-whose").textContent = `of all vehicles' links; shown is what ${about.vehicle} has`;
    for (const button of find("can").querySelectorAll("button")) button.disabled = !topics.request;
    const isAddress = /^\w+:\/\//.test(about.source ?? "");
    const name = isAddress ? about.source : (about.source ?? "").split("/").slice(-2).join("/");
    find("source").textContent = [about.kind, name].filter(Boolean).join(" ");
    find("source").title = about.source;
    if (about.notes?.length) tell(about.notes.join(" "));
  } catch (error) {
    tell(`The server does not say what it shows: ${error.message}`);
  }
}

const set = (parameters) => connection.setParameters(parameters);
const map = new FactoryMap(find("map"), find("ground"));
const lanes = new Lanes(find("lanes"));
const plots = new Plots(find("plots"));
const errors = new ErrorPicture(find("error-picture"));
const controls = new Controls(find("settings"), find("answer"), set);
const playback = new PlaybackBar(find("playback"), set);
const table = new ChannelTable(find("table-panel"));

/** The server adds time, run and number. */
function ask(request) {
  connection.publish(topics.request, REQUEST_SCHEMA, { request });
}

const ALIVE_EVERY_MS = 100;
let alive_ms = 0;
const drive = new Drive(find("drive"), (twist) => {
  connection.publish(topics.twist, TWIST_SCHEMA, twist);
  if (!model.shown?.drivetrain || !topics.request || performance.now() < alive_ms + ALIVE_EVERY_MS) return;
  alive_ms = performance.now();
  ask("ALIVE"); // who holds the dead man is the operator who holds to run
});

for (const [id, request] of [
  ["estop", "ESTOP"],
  ["arm", "ARM"],
  ["disarm", "DISARM"],
  ["release", "ESTOP_RELEASE"],
  ["reset", "RESET"],
]) {
  find(id).addEventListener("click", () => ask(request));
}

function press(id, toggle) {
  find(id).addEventListener("click", () => find(id).setAttribute("aria-pressed", toggle()));
}
press("stage", () => document.body.classList.toggle("stage"));
press("follow", () => (map.following = !map.following));
find("zoom-in").addEventListener("click", () => map.camera.zoom(1.4));
find("zoom-out").addEventListener("click", () => map.camera.zoom(1 / 1.4));
find("zoom-fit").addEventListener("click", () => {
  map.following = false;
  find("follow").setAttribute("aria-pressed", false);
  map.fit();
});
if (options.has("stage")) find("stage").click();
document.body.classList.toggle("poster", options.has("poster"));

addEventListener("keydown", (event) => {
  if (event.target.closest?.("input, select") || event.ctrlKey || event.metaKey) return;
  if (event.code === "KeyF") find("stage").click();
  if (event.code === "Escape" && model.shown?.drivetrain) find("estop").click();
  if (!playback.isThere || drive.isThere) return;
  if (event.code === "Space" && event.target.tagName !== "BUTTON") {
    event.preventDefault();
    playback.toggle();
  }
  if (event.code === "ArrowLeft") playback.step(-1);
  if (event.code === "ArrowRight") playback.step(1);
});

const legend = () => LEGEND.filter(({ isThere }) => !isThere || isThere(map, model.shown));

function drawLegend() {
  find("legend").replaceChildren(
    ...legend().map(({ name, draw }) => {
      const canvas = Object.assign(document.createElement("canvas"), { width: 60, height: 32 });
      const c = canvas.getContext("2d");
      c.scale(2, 2);
      draw(c);
      const item = document.createElement("li");
      item.append(canvas, name);
      return item;
    }),
  );
}
drawLegend();
onTheme(drawLegend);
map.onScene = drawLegend;

const choice = find("vehicle");
choice.addEventListener("change", () => {
  model.selected = choice.value;
  model.series.clear();
  showFacts(find("facts"), model);
});

/** Unknown before the server has reported what it shows. */
const hasRelay = () => model.about !== null && model.hasRelay;

/** What need not be as quick as the picture. */
function slowly() {
  const now_s = model.now_s(clock_s());
  showNumbers(model, now_s, map.scene.lostBeyond_m, model.silence_s(clock_s()));
  showDrivetrain(find("can"), model.shown?.drivetrain);
  showPeers(find("link"), model, clock_s());
  showDriver(find("driver"), model.shown?.autonomy);
  if (model.shown) showLocalisation(find("localisation"), model.shown.fixes);
  if (!find("localisation").hidden) errors.draw(model.shown.fixes.all);
  if (find("legend").childElementCount !== legend().length) drawLegend();
  find("run-time").textContent = model.clock ? `${now_s.toFixed(1)} s` : "–";
  playback.run(clock_s());
  if (controls.hasRelay !== hasRelay()) {
    controls.showRelay(hasRelay());
    showFacts(find("facts"), model);
  }
  table.update(model.channels, now_s + (model.offset_s ?? 0));
  const keys = [...model.vehicles.keys()].join();
  if (choice.dataset.keys !== keys) {
    choice.dataset.keys = keys;
    const all = [...model.vehicles.values()].sort((a, b) => Number(a.key) - Number(b.key));
    choice.replaceChildren(...all.map((vehicle) => new Option(vehicle.name, vehicle.key)));
    choice.value = model.selected;
    find("vehicle-choice").hidden = all.length < 2;
  }
}
setInterval(slowly, 100);

const frames = { count: 0, since_s: clock_s(), longest_s: 0, last_s: clock_s(), perSecond: 0, total: 0 };

function countFrame(now_s) {
  frames.longest_s = Math.max(frames.longest_s, now_s - frames.last_s);
  frames.last_s = now_s;
  ++frames.count;
  ++frames.total;
  if (now_s - frames.since_s < 1) return;
  frames.perSecond = frames.count / (now_s - frames.since_s);
  find("frames").textContent = `${frames.perSecond.toFixed(0)} fps`;
  frames.count = 0;
  frames.since_s = now_s;
}

function draw() {
  requestAnimationFrame(draw);
  const heard_s = clock_s();
  const now_s = model.now_s(heard_s);
  model.sample(now_s, model.silence_s(heard_s));
  map.draw(model, now_s);
  lanes.draw(model, now_s);
  plots.draw(model.series, now_s);
  countFrame(heard_s);
}

globalThis.tether = { model, connection, map, frames, drive }; // for tests and the curious
connection.open();
draw();
