// Reads an MCAP file with the TypeScript library, once by its index and once from front to back, all checksums checked.
import { open } from "node:fs/promises";
import { McapIndexedReader, McapStreamReader } from "@mcap/core";
import { FileHandleReadable } from "@mcap/nodejs";
import zstd from "@foxglove/wasm-zstd";

await zstd.isLoaded;
const decompressHandlers = { zstd: (data, size) => zstd.decompress(data, Number(size)) };
const file = await open(process.argv[2]);

const reader = await McapIndexedReader.Initialize({ readable: new FileHandleReadable(file), decompressHandlers });
const topics = {};
let indexed = 0;
for await (const message of reader.readMessages({ validateCrcs: true })) {
  const { topic } = reader.channelsById.get(message.channelId);
  topics[topic] = (topics[topic] ?? 0) + 1;
  indexed++;
}
for await (const attachment of reader.readAttachments({ validateCrcs: true })) attachment.data;

const stream = new McapStreamReader({ decompressHandlers, validateCrcs: true });
stream.append(await file.readFile());
const streamed = {};
for (let record; (record = stream.nextRecord()); ) streamed[record.type] = (streamed[record.type] ?? 0) + 1;

const stated = reader.statistics;
const agreed =
  stream.done() &&
  indexed === streamed.Message &&
  indexed === Number(stated.messageCount) &&
  reader.chunkIndexes.length === stated.chunkCount &&
  streamed.Attachment === stated.attachmentCount &&
  streamed.Metadata === stated.metadataCount;
console.log(JSON.stringify({ agreed, indexed, streamed, topics }));
process.exit(agreed ? 0 : 1);
