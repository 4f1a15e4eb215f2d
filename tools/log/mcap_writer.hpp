#pragma once

#include <boost/crc.hpp>
#include <cstdint>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace tether {

/// Writes values as MCAP serialises them ("Serialization", mcap.dev/spec): little-endian integers,
/// and texts, arrays and maps with their length in bytes before them.
class McapBytes {
 public:
  std::string bytes;

  void u8(std::uint8_t x) { bytes += static_cast<char>(x); }
  void u16(std::uint16_t x) { little_endian(x, 2); }
  void u32(std::uint32_t x) { little_endian(x, 4); }
  void u64(std::uint64_t x) { little_endian(x, 8); }
  void raw(std::string_view text) { bytes += text; }
  void text(std::string_view text) {
    u32(static_cast<std::uint32_t>(text.size()));
    raw(text);
  }

  /// An array or a map: `write()` writes its elements, the length in front comes after.
  template <class Write>
  void sized(Write write) {
    const std::size_t at = bytes.size();
    u32(0);
    write();
    put(at, bytes.size() - at - 4, 4);
  }

  /// A record: opcode, u64 length, content.
  template <class Write>
  void record(std::uint8_t opcode, Write write) {
    u8(opcode);
    const std::size_t at = bytes.size();
    u64(0);
    write();
    put(at, bytes.size() - at - 8, 8);
  }

 private:
  void little_endian(std::uint64_t x, int size) {
    char digits[8];
    for (int i = 0; i < size; ++i) digits[i] = static_cast<char>(x >> (8 * i));
    bytes.append(digits, static_cast<std::size_t>(size));
  }
  void put(std::size_t at, std::uint64_t x, std::size_t size) {
    for (std::size_t i = 0; i < size; ++i) bytes[at + i] = static_cast<char>(x >> (8 * i));
  }
};

/// Compresses chunks as zstd frames; the same bytes for the same input and version of libzstd.
class ChunkCompressor {
 public:
  ChunkCompressor();
  ~ChunkCompressor();
  ChunkCompressor(const ChunkCompressor&) = delete;
  ChunkCompressor& operator=(const ChunkCompressor&) = delete;

  /// Valid until the next call. Throws std::runtime_error with zstd's reason.
  std::string_view compress(std::string_view bytes);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// Writes MCAP, a container for time-stamped messages of any encoding, as specified on
/// mcap.dev/spec (version "0" of its magic bytes):
///
///     magic  Header  (Chunk  MessageIndex…)…  Metadata…  DataEnd
///     Schema…  Channel…  ChunkIndex…  MetadataIndex…  Statistics  SummaryOffset…  Footer  magic
///
/// All messages are in chunks, and the schemas and channels that they need in the same chunk or an
/// earlier one, so a file that breaks off can be read up to there. All CRC32s are real: of each
/// chunk, of the data section and of the summary. No clock, no file: bytes go to a sink. Equal
/// calls give equal bytes.
class McapWriter {
 public:
  using Sink = std::function<void(std::string_view bytes)>;
  using Texts = std::map<std::string, std::string>;

  enum class Compression { none, zstd };
  struct Options {
    std::string profile;                ///< "ros2" or nothing
    std::string library = "tether";     ///< who wrote it
    std::size_t chunk_bytes = 1 << 20;  ///< a chunk ends with the message that makes it this large
    Compression compression = Compression::zstd;
  };

  struct Message {
    std::uint16_t channel = 0;  ///< id from add_channel()
    std::uint32_t sequence = 0;
    std::uint64_t log_time_ns = 0;
    std::uint64_t publish_time_ns = 0;
    std::string_view data;
  };

  /// Schemas and channels are numbered in 16 bits, schemas from 1.
  static constexpr std::size_t kMostIds = std::numeric_limits<std::uint16_t>::max();

  /// Writes magic and header at once. What `sink` throws goes through.
  McapWriter(Options options, Sink sink);

  /// `encoding`: "jsonschema", "ros2msg". Its number, for add_channel(). Asserts below kMostIds.
  std::uint16_t add_schema(std::string_view name, std::string_view encoding, std::string_view data);
  /// `encoding` of its messages: "json", "cdr". `schema`: 0 for none.
  std::uint16_t add_channel(std::uint16_t schema, std::string_view topic, std::string_view encoding,
                            const Texts& metadata = {});

  void write(const Message& message);

  /// Named texts that belong to the file as a whole. Ends the chunk.
  void add_metadata(std::string_view name, const Texts& texts);

  /// The rest of the file. Nothing may be written afterwards.
  void finish();

  std::uint64_t message_count() const { return message_count_; }
  std::uint64_t byte_count() const { return offset_; }

 private:
  struct Place {
    std::uint64_t log_time_ns, offset;
  };
  struct Span {
    std::uint64_t first_ns = 0, last_ns = 0;
    bool any = false;
    void add(std::uint64_t time_ns);
  };

  void emit(std::string_view bytes);
  void end_chunk();
  std::vector<std::pair<std::uint16_t, std::uint64_t>> write_message_indexes();
  void write_data_end();
  void write_summary();
  void write_statistics(McapBytes& out) const;

  Options options_;
  Sink sink_;
  ChunkCompressor compressor_;
  std::uint64_t offset_ = 0;     // in the file
  boost::crc_32_type file_crc_;  // CRC of the file so far
  McapBytes scratch_;            // a record on its way

  McapBytes chunk_;  // uncompressed
  Span chunk_span_;
  std::map<std::uint16_t, std::vector<Place>> chunk_places_;  // by channel

  // Records that the summary repeats: whole records, and how many of each.
  McapBytes schemas_, channels_, chunk_indexes_, metadata_indexes_;
  std::uint16_t schema_count_ = 0, channel_count_ = 0;
  std::uint32_t chunk_count_ = 0, metadata_count_ = 0;
  std::uint64_t message_count_ = 0;
  std::vector<std::uint64_t> channel_message_counts_;
  Span span_;
  bool finished_ = false;
};

}  // namespace tether
