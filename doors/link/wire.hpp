#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>
#include <type_traits>
#include <variant>
#include <vector>

namespace tether::link {

using Bytes = std::vector<std::uint8_t>;
using ByteView = std::span<const std::uint8_t>;

/// Appends numbers, the most significant byte first.
class Writer {
 public:
  /// `out` must outlive the writer.
  explicit Writer(Bytes& out) : out_(out) {}

  template <class Number>
  Writer& number(Number value) {
    auto bits = static_cast<std::make_unsigned_t<Number>>(value);
    for (std::size_t i = sizeof bits; i-- > 0;) {
      out_.push_back(static_cast<std::uint8_t>(bits >> (8 * i)));
    }
    return *this;
  }
  Writer& bytes(ByteView bytes) {
    out_.insert(out_.end(), bytes.begin(), bytes.end());
    return *this;
  }

 private:
  Bytes& out_;
};

/// Reads what a Writer wrote. Beyond the end everything is zero or empty, and ok() false.
class Reader {
 public:
  explicit Reader(ByteView bytes) : rest_(bytes) {}

  template <class Number>
  Number number() {
    std::make_unsigned_t<Number> bits = 0;
    for (const std::uint8_t byte : take(sizeof bits)) {
      bits = static_cast<std::make_unsigned_t<Number>>(std::uint64_t{bits} << 8 | byte);
    }
    return static_cast<Number>(bits);
  }
  ByteView take(std::size_t size) {
    if (size > rest_.size()) {
      ok_ = false;
      rest_ = {};
      return {};
    }
    const ByteView taken = rest_.first(size);
    rest_ = rest_.subspan(size);
    return taken;
  }
  /// The next bytes as an array.
  template <class Array>
  Array array() {
    Array out{};
    const ByteView taken = take(out.size());
    std::copy(taken.begin(), taken.end(), out.begin());
    return out;
  }
  ByteView rest() const { return rest_; }
  /// Nothing was asked for that is not there.
  bool ok() const { return ok_; }
  bool ended() const { return ok_ && rest_.empty(); }

 private:
  ByteView rest_;
  bool ok_ = true;
};

// Datagrams of tether-link over UDP. Numbers have their most significant byte first; times are
// nanoseconds since 1970 on the sender's wall clock. All datagrams begin with
//
//   0  1  version, kVersion          in clear, and covered by what authenticates the datagram
//   1  1  kind
//
// HELLO, from the initiator of a session; 86 bytes:
//   2  8  key id of the sender: the first bytes of BLAKE2b of its public key
//  10  4  session: the number under which the sender wants to hear
//  14  8  time
//  22 32  ephemeral public key
//  54 32  MAC of all before, with a key that only the two owners of the static keys can compute
//
// ANSWER to a HELLO; 82 bytes, fewer than what it answers:
//   2  4  session: the HELLO's
//   6  4  session: the number under which the answering side wants to hear
//  10  8  time
//  18 32  ephemeral public key
//  50 16  MAC of the HELLO and all before, with a key that only the two owners can compute
//  66 16  MAC of HELLO and ANSWER, with a key of the session
//
// SEALED, everything else; 30 bytes and the text:
//   2  4  session: the receiver's number
//   6  8  counter: 0, 1, 2 … in this session and direction; the nonce
//  14  …  ChaCha20-Poly1305 (RFC 8439) of the text, with the 14 bytes before as associated data
//
// A datagram that goes over two paths is byte by byte the same on both: sealing another text, or
// another header, under the same counter would give the key away.
//
// Texts begin with
//
//   0  1  kind
//   1  8  time of sealing
//
// PROBE, of one path; those of all paths are sealed in a row, in the order of the paths:
//   9  1  path: its number at the sender
//  10  8  sealed datagrams sent on it in this session, this one too
//  18  8  time of the last PROBE that came by this path, as it says itself; 0: none
//  26  8  when it arrived, by the sender's clock
//  34  …  padding, of any content: some are as long as datagrams may be
//
// PIECE of a message, those of one message under consecutive counters:
//   9  1  flags; bit 0: acknowledge this
//  10  2  number of the piece, from 0
//  12  2  pieces of the message
//  14  …  piece 0: length of the channel's name (1), the name; then, in all, bytes of the message
//
// ACK:
//   9  8  the newest counter accepted
//  17  8  bit i: newest − i was accepted

inline constexpr std::uint8_t kVersion = 2;
enum class Kind : std::uint8_t { hello = 1, answer = 2, sealed = 3 };

inline constexpr std::size_t kHelloBytes = 86;
inline constexpr std::size_t kAnswerBytes = 82;
inline constexpr std::size_t kMacBytes = 32;
inline constexpr std::size_t kSealedHeaderBytes = 14;
inline constexpr std::size_t kTagBytes = 16;
inline constexpr std::size_t kPieceHeaderBytes = 14;
inline constexpr std::size_t kProbeBytes = 34;
/// No message needs more pieces.
inline constexpr std::size_t kMostPieces = 2048;
/// Maximum size of a carried LCM message.
inline constexpr std::size_t kMostMessageBytes = std::size_t{1} << 20;
/// Maximum length of a channel name, as in LCM.
inline constexpr std::size_t kMostChannelBytes = 63;
/// Paths to a peer.
inline constexpr std::size_t kMostPaths = 2;

using Key = std::array<std::uint8_t, 32>;  ///< a public, secret or symmetric key
using Mac = std::array<std::uint8_t, kMacBytes>;

struct Hello {
  std::uint64_t key_id = 0;
  std::uint32_t session = 0;
  std::int64_t wall_ns = 0;
  Key ephemeral{};
  Mac mac{};
};
struct Answer {
  std::uint32_t to_session = 0;
  std::uint32_t session = 0;
  std::int64_t wall_ns = 0;
  Key ephemeral{};
  Mac mac{};
};
struct SealedHeader {
  std::uint32_t session = 0;
  std::uint64_t counter = 0;
};

/// Without the MAC, which is to be appended.
Bytes to_bytes(const Hello& hello);
Bytes to_bytes(const Answer& answer);
void append(Bytes& out, const SealedHeader& header);

/// `datagram` is of this version. nullopt: it has another kind or length.
std::optional<Hello> read_hello(ByteView datagram);
std::optional<Answer> read_answer(ByteView datagram);
std::optional<SealedHeader> read_sealed_header(ByteView datagram);

struct Probe {
  std::uint8_t path = 0;
  std::uint64_t sent = 0;
  std::int64_t echo_wall_ns = 0;
  std::int64_t echo_arrival_ns = 0;
  std::size_t padding = 0;  ///< bytes
};
struct Piece {
  bool wants_ack = false;
  std::uint16_t number = 0;
  std::uint16_t count = 0;
  std::string_view channel;  ///< set in piece 0
  ByteView bytes;
};
struct Ack {
  std::uint64_t newest = 0;
  std::uint64_t bits = 0;
};
struct Text {
  std::int64_t wall_ns = 0;
  std::variant<Probe, Piece, Ack> what;
};

/// Replaces what is in `out`.
void write_text(Bytes& out, const Text& text);
/// The views of the result refer to `bytes`. nullopt: malformed, which an honest peer never sends.
std::optional<Text> read_text(ByteView bytes);

/// Whether a time that a peer says, in ns, is one; differences of two do not overflow.
constexpr bool is_time(std::int64_t ns) { return ns >= 0 && ns <= INT64_MAX / 2; }

}  // namespace tether::link
