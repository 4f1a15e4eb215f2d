#include "tools/log/mcap_writer.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <zstd.h>

#include <map>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

// The layout is read here a second time, from the tables of mcap.dev/spec.

namespace tether {
namespace {

using testing::ElementsAre;
using namespace std::string_view_literals;

constexpr std::string_view kMagic = "\x89MCAP0\r\n"sv;

/// CRC-32 as in zlib, bit by bit.
std::uint32_t crc32(std::string_view bytes) {
  std::uint32_t crc = 0xFFFFFFFFU;
  for (const char c : bytes) {
    crc ^= static_cast<std::uint8_t>(c);
    for (int i = 0; i < 8; ++i) crc = crc >> 1 ^ ((crc & 1U) != 0 ? 0xEDB88320U : 0U);
  }
  return ~crc;
}

/// Takes values from the front.
class Cursor {
 public:
  explicit Cursor(std::string_view bytes) : rest(bytes) {}
  std::string_view rest;

  std::uint64_t number(std::size_t size) {
    std::uint64_t value = 0;
    for (std::size_t i = 0; i < size; ++i) {
      value |= std::uint64_t{static_cast<std::uint8_t>(rest.at(i))} << (8 * i);
    }
    rest.remove_prefix(size);
    return value;
  }
  std::string_view bytes(std::size_t size) {
    if (size > rest.size()) throw std::out_of_range("beyond the end");
    const std::string_view taken = rest.substr(0, size);
    rest.remove_prefix(size);
    return taken;
  }
  std::string text() { return std::string(bytes(number(4))); }
};

struct Record {
  int opcode = 0;
  std::size_t begin = 0, end = 0;  // in what was read, with opcode and length
  std::string_view content;
  Cursor at(std::size_t offset = 0) const { return Cursor(content.substr(offset)); }
};

std::vector<Record> records_of(std::string_view bytes, std::size_t from = 0) {
  std::vector<Record> records;
  Cursor cursor(bytes.substr(from));
  while (!cursor.rest.empty()) {
    Record record;
    record.begin = bytes.size() - cursor.rest.size();
    record.opcode = static_cast<int>(cursor.number(1));
    record.content = cursor.bytes(cursor.number(8));
    record.end = bytes.size() - cursor.rest.size();
    records.push_back(record);
  }
  return records;
}

/// Records of a whole file, without the magic at both ends.
/// They refer to `file`.
std::vector<Record> records_of_file(const std::string& file) {
  EXPECT_TRUE(file.starts_with(kMagic));
  EXPECT_TRUE(file.ends_with(kMagic));
  return records_of(std::string_view(file).substr(0, file.size() - kMagic.size()), kMagic.size());
}

std::vector<Record> with_opcode(const std::vector<Record>& records, int opcode) {
  std::vector<Record> found;
  for (const Record& record : records) {
    if (record.opcode == opcode) found.push_back(record);
  }
  return found;
}

std::vector<int> opcodes(const std::vector<Record>& records) {
  std::vector<int> all;
  for (const Record& record : records) all.push_back(record.opcode);
  return all;
}

std::string written(const McapWriter::Options& options,
                    const std::function<void(McapWriter&)>& write) {
  std::string file;
  McapWriter writer(options, [&](std::string_view bytes) { file += bytes; });
  write(writer);
  writer.finish();
  EXPECT_EQ(writer.byte_count(), file.size());
  return file;
}

const McapWriter::Options kPlain{"", "test", 1000, McapWriter::Compression::none};

/// Two schemas, three channels, 40 messages of 50 bytes, and a remark.
void write_some(McapWriter& writer) {
  const auto pose = writer.add_schema("a.Pose", "jsonschema", "{}");
  const auto odd = writer.add_channel(pose, "odd", "json");
  const auto even = writer.add_channel(pose, "even", "json", {{"k", "v"}, {"l", ""}});
  for (std::uint32_t i = 0; i < 40; ++i) {
    const std::string data(50, static_cast<char>('A' + i % 26));
    writer.write({i % 2 == 0 ? even : odd, i, 1000 - 10 * i, 7, data});
  }
  const auto late = writer.add_channel(writer.add_schema("b", "", ""), "late", "json");
  writer.write({late, 5, 9'000, 9'001, "x"});
  writer.add_metadata("remarks", {{"who", "me"}});
}

std::string records_of_chunk(const Record& chunk) {
  Cursor c = chunk.at();
  c.bytes(16);
  const std::size_t size = c.number(8);
  c.number(4);
  const std::string compression = c.text();
  const std::string_view packed = c.bytes(c.number(8));
  if (compression.empty()) return std::string(packed);
  EXPECT_EQ(compression, "zstd");
  std::string all(size, '\0');
  EXPECT_EQ(ZSTD_decompress(all.data(), all.size(), packed.data(), packed.size()), size);
  return all;
}

TEST(McapWriter, AFileWithoutMessagesIsTheseBytes) {
  const std::string file = written({"ros2", "tether", 1 << 20}, [](McapWriter&) {});
  std::string expected(kMagic);
  expected += "\x01\x12\0\0\0\0\0\0\0\x04\0\0\0ros2\x06\0\0\0tether"sv;
  McapBytes data_crc;
  data_crc.u32(crc32(expected));
  expected += "\x0f\x04\0\0\0\0\0\0\0"sv;
  expected += data_crc.bytes;
  const std::size_t summary = expected.size();
  expected += "\x0b\x2e\0\0\0\0\0\0\0"sv;  // Statistics: 46 bytes, all zero
  expected += std::string(46, '\0');
  const std::size_t offsets = expected.size();
  expected += "\x0e\x11\0\0\0\0\0\0\0\x0b"sv;
  McapBytes rest;
  rest.u64(summary);
  rest.u64(9 + 46);
  rest.raw("\x02\x14\0\0\0\0\0\0\0"sv);  // Footer: 20 bytes
  rest.u64(summary);
  rest.u64(offsets);
  expected += rest.bytes;
  McapBytes crc;
  crc.u32(crc32(std::string_view(expected).substr(summary)));
  expected += crc.bytes;
  expected += kMagic;
  EXPECT_EQ(file, expected);
}

TEST(McapWriter, RecordsComeInTheOrderOfTheSpecification) {
  const std::string file = written(kPlain, write_some);
  const auto records = records_of_file(file);
  // Header; chunks of two channels with their indexes; the last, of three; Metadata; DataEnd; then
  // Schemas, Channels, ChunkIndexes, MetadataIndex, Statistics, SummaryOffsets and Footer.
  EXPECT_THAT(opcodes(records),
              ElementsAre(1, 6, 7, 7, 6, 7, 7, 6, 7, 7, 6, 7, 7, 7, 0x0C, 0x0F, 3, 3, 4, 4, 4, 8, 8,
                          8, 8, 0x0D, 0x0B, 0x0E, 0x0E, 0x0E, 0x0E, 0x0E, 2));
}

TEST(McapWriter, EveryMessageIsThereInItsChunkBehindItsChannelAndSchema) {
  const std::string file = written(kPlain, write_some);
  std::map<std::uint64_t, std::string> topics;
  std::map<std::uint64_t, std::string> schemas;
  std::uint32_t messages = 0;
  for (const Record& chunk : with_opcode(records_of_file(file), 6)) {
    const std::string inside = records_of_chunk(chunk);
    for (const Record& record : records_of(inside)) {
      Cursor c = record.at();
      const std::uint64_t id = c.number(2);
      if (record.opcode == 3) {
        schemas[id] = c.text();
      } else if (record.opcode == 4) {
        EXPECT_TRUE(schemas.contains(c.number(2)));
        topics[id] = c.text();
      } else {
        ASSERT_EQ(record.opcode, 5);
        if (messages < 40) {
          EXPECT_EQ(topics.at(id), messages % 2 == 0 ? "even" : "odd");
          EXPECT_EQ(c.number(4), messages);
          EXPECT_EQ(c.number(8), 1000 - 10 * messages);
          EXPECT_EQ(c.number(8), 7U);
          EXPECT_EQ(c.rest, std::string(50, static_cast<char>('A' + messages % 26)));
        } else {
          EXPECT_EQ(topics.at(id), "late");
          EXPECT_EQ(c.rest.substr(20), "x");
        }
        ++messages;
      }
    }
  }
  EXPECT_EQ(messages, 41U);
}

TEST(McapWriter, ChecksumsAreThoseOfTheBytes) {
  for (const auto compression : {McapWriter::Compression::none, McapWriter::Compression::zstd}) {
    const std::string file = written({"", "test", 1000, compression}, write_some);
    const auto records = records_of_file(file);
    for (const Record& chunk : with_opcode(records, 6)) {
      EXPECT_EQ(chunk.at(24).number(4), crc32(records_of_chunk(chunk)));
    }
    const Record data_end = with_opcode(records, 0x0F).at(0);
    EXPECT_EQ(data_end.at().number(4), crc32(std::string_view(file).substr(0, data_end.begin)));
    const std::size_t end = records.back().end;
    EXPECT_EQ(records.back().at(16).number(4),
              crc32(std::string_view(file).substr(data_end.end, end - 4 - data_end.end)));
  }
}

TEST(McapWriter, ChunkIndexesLeadToChunksAndTheirMessageIndexes) {
  const std::string file = written({"", "test", 1000}, write_some);
  const auto records = records_of_file(file);
  const auto chunks = with_opcode(records, 6);
  const auto indexes = with_opcode(records, 8);
  ASSERT_EQ(indexes.size(), chunks.size());
  for (std::size_t i = 0; i < chunks.size(); ++i) {
    Cursor index = indexes[i].at(), chunk = chunks[i].at();
    EXPECT_EQ(index.number(8), chunk.number(8));  // earliest message
    EXPECT_EQ(index.number(8), chunk.number(8));  // latest
    EXPECT_EQ(index.number(8), chunks[i].begin);
    EXPECT_EQ(index.number(8), chunks[i].end - chunks[i].begin);
    Cursor map(index.bytes(index.number(4)));
    std::uint64_t length = 0;
    while (!map.rest.empty()) {
      const std::uint64_t channel = map.number(2), offset = map.number(8);
      const auto found = std::ranges::find(records, offset, &Record::begin);
      ASSERT_NE(found, records.end());
      EXPECT_EQ(found->opcode, 7);
      EXPECT_EQ(found->at().number(2), channel);
      length += found->end - found->begin;
    }
    EXPECT_EQ(index.number(8), length);
    EXPECT_EQ(index.text(), "zstd");
    const std::uint64_t compressed = index.number(8), uncompressed = index.number(8);
    EXPECT_EQ(uncompressed, chunk.number(8));
    chunk.number(4);
    chunk.text();
    EXPECT_EQ(compressed, chunk.number(8));
    EXPECT_EQ(compressed, chunk.rest.size());
  }
}

TEST(McapWriter, MessageIndexesLeadToMessagesOfTheirChannelAndTime) {
  const std::string file = written({"", "test", 1000}, write_some);
  const auto records = records_of_file(file);
  std::string inside;
  std::size_t entries = 0;
  for (const Record& record : records) {
    if (record.opcode == 6) inside = records_of_chunk(record);
    if (record.opcode != 7) continue;
    Cursor index = record.at();
    const std::uint64_t channel = index.number(2);
    Cursor places(index.bytes(index.number(4)));
    while (!places.rest.empty()) {
      const std::uint64_t time_ns = places.number(8), offset = places.number(8);
      Cursor message(std::string_view(inside).substr(offset));
      EXPECT_EQ(message.number(1), 5U);
      message.number(8);
      EXPECT_EQ(message.number(2), channel);
      message.number(4);
      EXPECT_EQ(message.number(8), time_ns);
      ++entries;
    }
  }
  EXPECT_EQ(entries, 41U);
}

TEST(McapWriter, TheSummarySaysWhatTheFileHas) {
  const std::string file = written(kPlain, write_some);
  const auto records = records_of_file(file);
  Cursor statistics = with_opcode(records, 0x0B).at(0).at();
  EXPECT_EQ(statistics.number(8), 41U);    // messages
  EXPECT_EQ(statistics.number(2), 2U);     // schemas
  EXPECT_EQ(statistics.number(4), 3U);     // channels
  EXPECT_EQ(statistics.number(4), 0U);     // attachments
  EXPECT_EQ(statistics.number(4), 1U);     // metadata
  EXPECT_EQ(statistics.number(4), 4U);     // chunks
  EXPECT_EQ(statistics.number(8), 610U);   // earliest
  EXPECT_EQ(statistics.number(8), 9000U);  // latest
  Cursor counts(statistics.bytes(statistics.number(4)));
  for (const std::uint64_t count : {20U, 20U, 1U}) {
    counts.number(2);
    EXPECT_EQ(counts.number(8), count);
  }
  Cursor metadata = with_opcode(records, 0x0D).at(0).at();
  const Record remark = with_opcode(records, 0x0C).at(0);
  EXPECT_EQ(metadata.number(8), remark.begin);
  EXPECT_EQ(metadata.number(8), remark.end - remark.begin);
  EXPECT_EQ(metadata.text(), "remarks");
}

TEST(McapWriter, SummaryOffsetsSpanTheirGroupsAndTheFooterFindsThem) {
  const std::string file = written(kPlain, write_some);
  const auto records = records_of_file(file);
  const Record data_end = with_opcode(records, 0x0F).at(0);
  const auto offsets = with_opcode(records, 0x0E);
  std::size_t at = data_end.end;
  for (const Record& record : offsets) {
    Cursor c = record.at();
    const int opcode = static_cast<int>(c.number(1));
    EXPECT_EQ(c.number(8), at);
    const std::size_t end = at + c.number(8);
    for (const Record& inside : records) {
      const bool within = inside.begin >= at && inside.begin < end;
      EXPECT_EQ(within, inside.opcode == opcode && inside.begin >= data_end.end);
    }
    at = end;
  }
  EXPECT_EQ(at, offsets.front().begin);
  Cursor footer = records.back().at();
  EXPECT_EQ(footer.number(8), data_end.end);
  EXPECT_EQ(footer.number(8), offsets.front().begin);
}

TEST(McapWriter, EqualCallsGiveEqualBytes) {
  EXPECT_EQ(written({}, write_some), written({}, write_some));
}

TEST(McapWriter, WhatTheSinkThrowsEndsTheWriting) {
  const auto full = [](std::string_view) { throw std::runtime_error("full"); };
  EXPECT_THROW(McapWriter({}, full), std::runtime_error);
}

}  // namespace
}  // namespace tether
