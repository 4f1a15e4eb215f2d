#include "doors/link/wire.hpp"

#include <type_traits>

namespace tether::link {
namespace {

enum class TextKind : std::uint8_t { probe = 1, piece = 2, ack = 3 };
constexpr std::uint8_t kWantsAck = 1;

template <class Enum>
std::uint8_t number_of(Enum value) {
  return static_cast<std::uint8_t>(value);
}

Reader begin(ByteView datagram, Kind kind, bool& is) {
  Reader reader(datagram);
  is =
      reader.number<std::uint8_t>() == kVersion && reader.number<std::uint8_t>() == number_of(kind);
  return reader;
}

std::optional<Probe> read_probe(Reader& r) {
  Probe p;
  p.path = r.number<std::uint8_t>();
  p.sent = r.number<std::uint64_t>();
  p.echo_wall_ns = r.number<std::int64_t>();
  p.echo_arrival_ns = r.number<std::int64_t>();
  p.padding = r.rest().size();
  if (!r.ok() || !is_time(p.echo_wall_ns) || !is_time(p.echo_arrival_ns)) return std::nullopt;
  return p;
}

std::optional<Ack> read_ack(Reader& r) {
  Ack ack;
  ack.newest = r.number<std::uint64_t>();
  ack.bits = r.number<std::uint64_t>();
  if (!r.ended()) return std::nullopt;
  return ack;
}

std::optional<Piece> read_piece(Reader& r) {
  Piece p;
  p.wants_ack = (r.number<std::uint8_t>() & kWantsAck) != 0;
  p.number = r.number<std::uint16_t>();
  p.count = r.number<std::uint16_t>();
  if (p.number == 0) {
    const ByteView name = r.take(r.number<std::uint8_t>());
    p.channel = {reinterpret_cast<const char*>(name.data()), name.size()};
    const bool is_name = !name.empty() && name.size() <= kMostChannelBytes &&
                         p.channel.find('\0') == std::string_view::npos;
    if (!is_name) return std::nullopt;
  }
  p.bytes = r.rest();
  if (!r.ok() || p.count > kMostPieces || p.number >= p.count) return std::nullopt;
  return p;
}

}  // namespace

Bytes to_bytes(const Hello& hello) {
  Bytes out;
  out.reserve(kHelloBytes);
  Writer(out)
      .number(kVersion)
      .number(number_of(Kind::hello))
      .number(hello.key_id)
      .number(hello.session)
      .number(hello.wall_ns)
      .bytes(hello.ephemeral);
  return out;
}

Bytes to_bytes(const Answer& answer) {
  Bytes out;
  out.reserve(kAnswerBytes);
  Writer(out)
      .number(kVersion)
      .number(number_of(Kind::answer))
      .number(answer.to_session)
      .number(answer.session)
      .number(answer.wall_ns)
      .bytes(answer.ephemeral);
  return out;
}

void append(Bytes& out, const SealedHeader& header) {
  Writer(out)
      .number(kVersion)
      .number(number_of(Kind::sealed))
      .number(header.session)
      .number(header.counter);
}

std::optional<Hello> read_hello(ByteView datagram) {
  bool is = false;
  Reader r = begin(datagram, Kind::hello, is);
  Hello hello;
  hello.key_id = r.number<std::uint64_t>();
  hello.session = r.number<std::uint32_t>();
  hello.wall_ns = r.number<std::int64_t>();
  hello.ephemeral = r.array<Key>();
  hello.mac = r.array<Mac>();
  if (!is || !r.ended()) return std::nullopt;
  return hello;
}

std::optional<Answer> read_answer(ByteView datagram) {
  bool is = false;
  Reader r = begin(datagram, Kind::answer, is);
  Answer answer;
  answer.to_session = r.number<std::uint32_t>();
  answer.session = r.number<std::uint32_t>();
  answer.wall_ns = r.number<std::int64_t>();
  answer.ephemeral = r.array<Key>();
  answer.mac = r.array<Mac>();
  if (!is || !r.ended()) return std::nullopt;
  return answer;
}

std::optional<SealedHeader> read_sealed_header(ByteView datagram) {
  bool is = false;
  Reader r = begin(datagram, Kind::sealed, is);
  SealedHeader header;
  header.session = r.number<std::uint32_t>();
  header.counter = r.number<std::uint64_t>();
  if (!is || !r.ok() || r.rest().size() < kTagBytes) return std::nullopt;
  return header;
}

void write_text(Bytes& out, const Text& text) {
  out.clear();
  Writer w(out);
  const auto begin_text = [&](TextKind kind) { w.number(number_of(kind)).number(text.wall_ns); };
  if (const auto* probe = std::get_if<Probe>(&text.what)) {
    begin_text(TextKind::probe);
    w.number(probe->path).number(probe->sent);
    w.number(probe->echo_wall_ns).number(probe->echo_arrival_ns);
    out.resize(out.size() + probe->padding);
  } else if (const auto* ack = std::get_if<Ack>(&text.what)) {
    begin_text(TextKind::ack);
    w.number(ack->newest).number(ack->bits);
  } else {
    const Piece& piece = std::get<Piece>(text.what);
    begin_text(TextKind::piece);
    w.number(piece.wants_ack ? kWantsAck : std::uint8_t{0});
    w.number(piece.number).number(piece.count);
    if (piece.number == 0) {
      w.number(static_cast<std::uint8_t>(piece.channel.size()));
      w.bytes({reinterpret_cast<const std::uint8_t*>(piece.channel.data()), piece.channel.size()});
    }
    w.bytes(piece.bytes);
  }
}

std::optional<Text> read_text(ByteView bytes) {
  Reader r(bytes);
  const auto kind = r.number<std::uint8_t>();
  Text text;
  text.wall_ns = r.number<std::int64_t>();
  if (!is_time(text.wall_ns)) return std::nullopt;
  const auto with = [&text](const auto& what) -> std::optional<Text> {
    if (!what) return std::nullopt;
    text.what = *what;
    return text;
  };
  if (kind == number_of(TextKind::piece)) return with(read_piece(r));
  if (kind == number_of(TextKind::probe)) return with(read_probe(r));
  if (kind == number_of(TextKind::ack)) return with(read_ack(r));
  return std::nullopt;
}

}  // namespace tether::link
