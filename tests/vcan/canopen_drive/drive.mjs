// A CiA 402 drive, profile velocity, on CANopen by npm's `canopen`, whose author never saw Tether. Frames
// are lines on stdin and stdout, "ID HEX"; reports are lines of JSON (relay.py, independent_drive).
//
// usage: node drive.mjs NODE [DATA_SHEET]     with a second word it writes its EDS there, and ends
import canopen from 'canopen';
import readline from 'node:readline';

const { Device, Eds, DataType, ObjectType, NmtState } = canopen;
const { UNSIGNED8: U8, UNSIGNED16: U16, UNSIGNED32: U32, INTEGER8: I8, INTEGER16: I16, INTEGER32: I32 } = DataType;

const RADIUS_M = 0.4;
const UNITS_PER_MPS = 12000 / (2 * Math.PI * RADIUS_M); // 0.1 rpm of a motor geared 1:20
const COUNTS_PER_UNIT_S = 4096 / 600;
const COAST_MPS2 = 0.5;
const MPS_STANDING = 0.004;
const TICK_MS = 5;

const node = Number(process.argv[2]);
const put = (id, data) => process.stdout.write(`${id.toString(16)} ${data.toString('hex')}\n`);
const tell = (facts) => process.stdout.write(JSON.stringify({ t: Date.now() / 1000, node, ...facts }) + '\n');

// --- object dictionary

const eds = new Eds();
const variable = (index, dataType, defaultValue = 0) =>
  eds.addEntry(index, { parameterName: index.toString(16), dataType, defaultValue, pdoMapping: true });

function array(index, dataTypes, values = []) {
  const entry = eds.addEntry(index, { parameterName: index.toString(16), objectType: ObjectType.RECORD });
  dataTypes.forEach((dataType, i) => entry.addSubObject(i + 1,
    { parameterName: `${index.toString(16)} ${i + 1}`, dataType, defaultValue: values[i] ?? 0 }));
}

const value = (index) => eds.getEntry(index).value;
const set = (index, to) => { eds.getEntry(index).value = to; };

function addObjects() {
  if (!eds.getEntry(0x1000)) variable(0x1000, U32);
  if (!eds.getEntry(0x1001)) variable(0x1001, U8);
  Object.assign(eds.getEntry(0x1000), { defaultValue: 0x00020192, value: 0x00020192 });
  variable(0x1017, U16); // before the library makes it an u32
  array(0x1016, [U32]);
  eds.setSyncCobId(0x80, { saveDefault: true });
  eds.addSdoServerParameter(node, 0x580 + node, 0x600 + node);
  if (eds.getEntry(0x1018)) eds.removeEntry(0x1018);
  array(0x1018, [U32, U32, U32, U32], [0x0000_0dab, 0x602, 0x0006_0002, 2000 + node]);
  for (let n = 0; n < 4; ++n) {
    for (const [parameters, base] of [[0x1400, 0x200], [0x1800, 0x180]]) {
      array(parameters + n, [U32, U8, U16], [0x8000_0000 + base + 0x100 * n + node, 255]);
      array(parameters + 0x200 + n, Array(8).fill(U32));
      eds.getEntry(parameters + 0x200 + n)[0].value = 0;
    }
  }
  variable(0x6007, I16, 1);
  variable(0x603f, U16);
  variable(0x6040, U16);
  variable(0x6041, U16);
  variable(0x605a, I16, 2);
  variable(0x605e, I16, 2);
  variable(0x6060, I8);
  variable(0x6061, I8);
  variable(0x6064, I32);
  variable(0x606c, I32);
  variable(0x6083, U32, 12000);
  variable(0x6084, U32, 12000);
  variable(0x6085, U32, 24000);
  variable(0x60ff, I32);
}

// --- the power drive system's states (IEC 61800-7-201)

const WORDS = {
  'switch on disabled': 0x40, 'ready to switch on': 0x21, 'switched on': 0x23, 'operation enabled': 0x27,
  'quick stop active': 0x07, 'fault': 0x08,
};
let state = 'switch on disabled';
let lastWord = 0;
let demand = 0; // of the speed controller, 0.1 rpm
let speed = 0; // of the motor, 0.1 rpm
let position = 0; // counts

const powered = () => state === 'operation enabled' || state === 'quick stop active';

function enter(next) {
  if (next === state) return;
  if (next === 'operation enabled') demand = speed;
  state = next;
  tell({ event: 'state', state });
}

function obey(word) {
  const reset = word & ~lastWord & 0x80;
  lastWord = word;
  if (state === 'fault') return reset ? enter('switch on disabled') : undefined;
  if (!(word & 2)) return enter('switch on disabled');
  if (!(word & 4)) return enter(powered() ? 'quick stop active' : 'switch on disabled');
  if (state === 'quick stop active') return undefined;
  switch (word & 0x0f) {
    case 0x06: return enter('ready to switch on');
    case 0x07: return state !== 'switch on disabled' ? enter('switched on') : undefined;
    case 0x0f: return state === 'switched on' ? enter('operation enabled') : undefined;
    default: return undefined;
  }
}

function masterLost() {
  if (!powered()) return;
  const reaction = value(0x6007);
  if (reaction === 1) enter('fault');
  if (reaction === 2) enter('switch on disabled');
  if (reaction === 3) enter('quick stop active');
}

// --- motion

const towards = (from, to, step) => from + Math.max(-step, Math.min(step, to - from));

function move(dt) {
  obey(value(0x6040));
  if (state === 'operation enabled' && value(0x6060) === 3) {
    const target = value(0x60ff);
    demand = towards(demand, target, dt * value(Math.abs(target) > Math.abs(demand) ? 0x6083 : 0x6084));
  } else if (state === 'quick stop active') {
    demand = towards(demand, 0, dt * value(0x6085));
  }
  if (powered()) speed += (demand - speed) * (1 - Math.exp(-dt / 0.02));
  else speed = towards(speed, 0, dt * COAST_MPS2 * UNITS_PER_MPS);
  const stands = Math.abs(speed) < MPS_STANDING * UNITS_PER_MPS;
  if (state === 'quick stop active' && demand === 0 && stands) enter('switch on disabled');
  position += speed * dt * COUNTS_PER_UNIT_S;
  set(0x6041, WORDS[state] | 0x0210 | (stands ? 0x1000 : 0));
  set(0x6061, value(0x6060));
  set(0x6064, Math.round(position) | 0);
  set(0x606c, Math.round(speed));
}

// --- the device

addObjects();
if (process.argv[3]) {
  eds.save(process.argv[3]);
  process.exit();
}
const device = new Device({ id: node, eds });
device.on('message', ({ id, data }) => put(id, Buffer.from(data)));
device.nmt.on('timeout', masterLost);
let booted = false;
device.nmt.on('changeState', (nmt) => {
  if (nmt === NmtState.PRE_OPERATIONAL && !booted) put(0x700 + node, Buffer.from([0])); // the library sends none
  booted = nmt !== NmtState.INITIALIZING;
  if (nmt === NmtState.INITIALIZING || nmt === NmtState.STOPPED) masterLost();
  if (nmt === NmtState.INITIALIZING) { state = 'switch on disabled'; lastWord = 0; }
});
device.start();

readline.createInterface({ input: process.stdin }).on('line', (line) => {
  const [id, hex] = line.split(' ');
  const data = Buffer.from(hex ?? '', 'hex');
  try {
    device.receive({ id: parseInt(id, 16), data, len: data.length });
  } catch (error) { // the library throws where it should abort a transfer
    tell({ event: 'thrown', what: String(error) });
  }
}).on('close', () => process.exit());

let last = process.hrtime.bigint();
let ticks = 0;
setInterval(() => {
  const now = process.hrtime.bigint();
  move(Number(now - last) / 1e9);
  last = now;
  if (++ticks % 10 === 0) tell({ rps: speed / 12000, turns: position / 81920 });
}, TICK_MS);
