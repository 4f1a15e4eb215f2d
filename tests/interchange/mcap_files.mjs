// Reads MCAP with @mcap/core and CSV tables of `tether log csv`.

import { McapIndexedReader, McapStreamReader } from "@mcap/core";
import { decompress } from "fzstd";
import { readFileSync, readdirSync } from "node:fs";
import { join } from "node:path";

export function check(condition, what) {
  if (!condition) throw new Error(what);
}

const decompressHandlers = {
  zstd: (bytes, size) => decompress(bytes, new Uint8Array(Number(size))),
};

/// All messages as {topic, schema, encoding, logTime, sequence, data}, in order of time; read by index and
/// once more as a stream, with all checksums validated.
export async function readMcap(file) {
  const bytes = new Uint8Array(readFileSync(file));
  const reader = await McapIndexedReader.Initialize({
    readable: {
      size: async () => BigInt(bytes.length),
      read: async (offset, size) => bytes.slice(Number(offset), Number(offset + size)),
    },
    decompressHandlers,
  });
  const messages = [];
  const counts = new Map();
  for await (const message of reader.readMessages({ validateCrcs: true })) {
    const channel = reader.channelsById.get(message.channelId);
    const schema = reader.schemasById.get(channel.schemaId);
    counts.set(channel.id, (counts.get(channel.id) ?? 0n) + 1n);
    messages.push({ ...message, topic: channel.topic, schema, encoding: channel.messageEncoding });
  }
  check(reader.chunkIndexes.length > 0, "no index");
  check(reader.statistics.messageCount === BigInt(messages.length), "statistics count other messages");
  check(reader.statistics.channelMessageCounts.size === counts.size, "statistics count other channels");
  for (const [id, count] of reader.statistics.channelMessageCounts) {
    check(counts.get(id) === count, `statistics: ${count} messages of channel ${id}`);
  }
  check(streamed(bytes) === messages.length, "the stream has other messages than the index");
  const metadata = [];
  for await (const record of reader.readMetadata()) metadata.push(record);
  return { header: reader.header, channels: [...reader.channelsById.values()], messages, metadata };
}

function streamed(bytes) {
  const reader = new McapStreamReader({ decompressHandlers, validateCrcs: true });
  reader.append(bytes);
  let count = 0;
  for (let record; (record = reader.nextRecord()); ) {
    if (record.type === "Message") ++count;
  }
  check(reader.done(), "the stream does not end with the file");
  return count;
}

/// RFC 4180, as far as `tether log csv` uses it: rows of cells.
function cellsOf(text) {
  const rows = [[]];
  const cell = /(?:"((?:[^"]|"")*)"|([^,\n]*))(,|\n)/g;
  for (const [, quoted, plain, end] of text.matchAll(cell)) {
    rows.at(-1).push(quoted === undefined ? plain : quoted.replaceAll('""', '"'));
    if (end === "\n") rows.push([]);
  }
  return rows.slice(0, -1);
}

/// Tables of a folder by channel name ("AGV_POSE"), each a list of {column: text}.
export function readTables(folder) {
  const tables = new Map();
  for (const name of readdirSync(folder)) {
    const [columns, ...rows] = cellsOf(readFileSync(join(folder, name), "utf8"));
    tables.set(
      name.replace(/\.csv$/, ""),
      rows.map((row) => Object.fromEntries(row.map((cell, i) => [columns[i], cell]))),
    );
  }
  return tables;
}

/// Nanoseconds of a column in seconds with six decimals.
export function nanoseconds(t_s) {
  const [whole, decimals] = t_s.split(".");
  return BigInt(whole + decimals) * 1000n;
}
