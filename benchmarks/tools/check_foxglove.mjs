// The libraries by which Foxglove reads: the file, each message by the definitions in it, and Foxglove's own definitions.
import { readFileSync } from "node:fs";
import { McapIndexedReader } from "@mcap/core";
import { parse } from "@foxglove/rosmsg";
import { MessageReader } from "@foxglove/rosmsg2-serialization";
import schemas from "@foxglove/schemas/internal.js";

const bytes = readFileSync(`${process.argv[2]}/forces.mcap`), said = JSON.parse(readFileSync(`${process.argv[2]}/forces.json`));
const read = async (from, count) => new Uint8Array(bytes.subarray(Number(from), Number(from + count)));
const file = await McapIndexedReader.Initialize({ readable: { size: async () => BigInt(bytes.length), read } });
const plain = (types) => new Map(types.map((type) => [type.name, type.definitions
  .filter((field) => !field.isConstant)
  .map(({ name, type: kind, isArray }) => `${kind}${isArray ? "[]" : ""} ${name}`).join("\n")]));
const theirs = plain(parse(schemas.generateRosMsgMergedSchema(schemas.foxgloveMessageSchemas.SceneUpdate, { rosVersion: 2 }), { ros2: true }));
const readers = new Map(), own = (name) => name?.startsWith("foxglove_msgs") || name === undefined;
let forces = 0, scenes = 0, worst = 0, types = 0;
for await (const message of file.readMessages({ validateCrcs: true })) {
  const { topic, schemaId } = file.channelsById.get(message.channelId);
  if (!readers.has(topic)) {
    const found = parse(new TextDecoder().decode(file.schemasById.get(schemaId).data), { ros2: true });
    readers.set(topic, new MessageReader(found));
    if (topic === "/scene") {
      for (const [name, fields] of plain(found)) {
        if (!own(name)) continue;
        if (theirs.get(name) !== fields) throw new Error(`${name}: ${fields} is not ${theirs.get(name)}`);
        types++;
      }
    }
  }
  const content = readers.get(topic).readMessage(message.data);
  scenes += topic === "/scene";
  if (!(topic in said)) continue;
  const { sec, nanosec } = content.header.stamp, { x, y, z } = content.wrench.force;
  const [force] = said[topic][String(1e9 * sec + nanosec)];
  [x, y, z].forEach((value, k) => { worst = Math.max(worst, Math.abs(value - force[k])); });
  forces++;
}
const all = Object.values(said).reduce((sum, one) => sum + Object.keys(one).length, 0);
if (!(forces === all && scenes > 0 && types > 10 && worst < 1e-9)) throw new Error(`${forces} forces, ${scenes} scenes, ${types} types, ${worst}`);
console.log(`found: checksums fit; ${forces} forces as written, to ${worst.toExponential(0)} N; ${scenes} scenes of ${types} types whose fields are Foxglove's`);
