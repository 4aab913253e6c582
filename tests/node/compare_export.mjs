// Decodes a recording with Foxglove's own packages and compares every number with a table of `hil export`.
//
//   node compare_export.mjs MODULES RUN.mcap TABLE.csv
//
// MODULES is the folder that `npm ci` was run in. Checks names, values and times of all records, and that
// the fields of every event are what its JSON says. Ends with 0 when all holds.

import assert from "node:assert/strict";
import { open, readFile } from "node:fs/promises";
import { createRequire } from "node:module";
import { resolve } from "node:path";

const [modules, recording, table] = process.argv.slice(2);
const require = createRequire(resolve(modules, "package.json"));
const { parse } = require("@foxglove/rosmsg");
const { MessageReader } = require("@foxglove/rosmsg2-serialization");
const { McapIndexedReader } = require("@mcap/core");
const { FileHandleReadable } = require("@mcap/nodejs");
const { loadDecompressHandlers } = require("@mcap/support");

/** Rows of a table without quotation marks: a list of objects by column. */
async function rows(path) {
  const [header, ...lines] = (await readFile(path, "utf8")).trimEnd().split("\n");
  const names = header.split(",");
  const number = (text) => ({ inf: Infinity, "-inf": -Infinity }[text] ?? Number(text));
  return { names, rows: lines.map((line) => line.split(",").map(number)) };
}

/** Every field is what the JSON has under its name; 0, false or empty where it has nothing. */
function assertFacts({ json, ...fields }) {
  const facts = JSON.parse(json);
  assert(facts.event);
  for (const [name, value] of Object.entries(fields)) {
    const plain = typeof value === "bigint" ? Number(value) : value;
    assert.equal(plain || undefined, facts[name] || undefined, name);
  }
}

const text = (data) => new TextDecoder().decode(data);
const reader = await McapIndexedReader.Initialize({
  readable: new FileHandleReadable(await open(recording)),
  decompressHandlers: await loadDecompressHandlers(),
});
const channels = new Map();
for (const channel of reader.channelsById.values()) {
  const schema = reader.schemasById.get(channel.schemaId);
  assert.equal(`${schema.encoding} ${channel.messageEncoding}`, "ros2msg cdr");
  const decoder = new MessageReader(parse(text(schema.data), { ros2: true }));
  channels.set(channel.id, { topic: channel.topic, decode: (data) => decoder.readMessage(data) });
}

const expected = await rows(table);
const place = new Map(expected.names.map((name, index) => [name, index]));
let [records, events] = [0, 0];
for await (const message of reader.readMessages()) {
  const { topic, decode } = channels.get(message.channelId);
  const decoded = decode(message.data);
  if (topic === "/events") {
    assertFacts(decoded);
    events += 1;
    continue;
  }
  assert.equal(topic, "/record");
  const row = expected.rows[records];
  assert.equal(Number(decoded.step), row[place.get("step")]);
  assert.equal(message.logTime, decoded.time_ns);
  assert.equal(Number(message.logTime) / 1e9, row[place.get("time_s")]);
  let signals = 0;
  for (const [group, fields] of Object.entries(decoded)) {
    for (const [name, value] of Object.entries(typeof fields === "object" ? fields : {})) {
      const column = place.get(`${group}.${name}`);
      if (column === undefined) continue;
      assert(Object.is(value, row[column]), `${group}.${name} at step ${decoded.step}: ${value}, ${row[column]}`);
      signals += 1;
    }
  }
  assert.equal(signals, expected.names.filter((name) => name.includes(".")).length, "signals");
  records += 1;
}
assert.equal(records, expected.rows.length);
console.log(`${records} records and ${events} events, the same numbers as decoded by Foxglove`);
