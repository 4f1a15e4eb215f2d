#include "doors/link/handshake.hpp"

#include <fmt/format.h>
#include <sodium.h>

#include <cassert>
#include <initializer_list>
#include <string_view>

#include "common/base/errors.hpp"

namespace tether::link {
namespace {

/// An ANSWER has two, so that it stays shorter than what it answers.
constexpr std::size_t kHalfMacBytes = kMacBytes / 2;
constexpr std::string_view kProtocol = "tether-link 2 KK X25519 ChaChaPoly BLAKE2b";

ByteView view(std::string_view text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

/// BLAKE2b of 32 bytes over all parts, each of which has a length that the protocol fixes.
Key hash_of(ByteView key, std::initializer_list<ByteView> parts) {
  crypto_generichash_state state;
  Key out{};
  crypto_generichash_init(&state, key.empty() ? nullptr : key.data(), key.size(), out.size());
  for (const ByteView part : parts) {
    crypto_generichash_update(&state, part.data(), part.size());
  }
  crypto_generichash_final(&state, out.data(), out.size());
  return out;
}

/// X25519; false for points of low order, whose product is known to everybody.
bool multiply(Key& out, const Key& secret, const Key& point) {
  return crypto_scalarmult(out.data(), secret.data(), point.data()) == 0;
}

bool equal(ByteView a, ByteView b) {
  return a.size() == b.size() && sodium_memcmp(a.data(), b.data(), a.size()) == 0;
}

ByteView without_mac(ByteView datagram) { return datagram.first(datagram.size() - kMacBytes); }

/// Keys that both sides compute.
struct Derived {
  Key to_responder{};
  Key to_initiator{};
  Mac answer_mac{};
};

Derived derive(const Key& ss, Key es, Key se, Key ee, ByteView hello, ByteView answer_head) {
  Key master = hash_of(view(kProtocol), {ss, es, se, ee, hello, answer_head});
  static_assert(sizeof(Key) == crypto_kdf_KEYBYTES);
  const auto sub_key = [&master](std::uint64_t number) {
    Key out{};
    crypto_kdf_derive_from_key(out.data(), out.size(), number, "tetherln", master.data());
    return out;
  };
  Derived d;
  d.to_responder = sub_key(1);
  d.to_initiator = sub_key(2);
  Key mac_key = sub_key(3);
  d.answer_mac = hash_of(mac_key, {hello, answer_head});
  for (Key* secret : {&master, &mac_key, &es, &se, &ee}) wipe(*secret);
  return d;
}

}  // namespace

Identity::Identity(const KeyPair& own, const Key& peer) : own_(own), peer_(peer) {
  if (!multiply(shared_, own.secret_key, peer) || own.public_key == peer) {
    throw UsageError(
        fmt::format("the public key {} cannot be a peer's: {}", key_text(peer),
                    own.public_key == peer ? "it is this host's own" : "it is not an X25519 key"));
  }
  own_hello_key_ = hash_of(shared_, {view("hello"), own_.public_key, peer_});
  peer_hello_key_ = hash_of(shared_, {view("hello"), peer_, own_.public_key});
  own_answer_key_ = hash_of(shared_, {view("answer"), own_.public_key, peer_});
  peer_answer_key_ = hash_of(shared_, {view("answer"), peer_, own_.public_key});
}

Bytes Handshake::hello(const Identity& identity, const KeyPair& ephemeral, std::uint32_t session,
                       std::int64_t wall_ns) {
  Bytes out =
      to_bytes(Hello{key_id(identity.own_.public_key), session, wall_ns, ephemeral.public_key, {}});
  Writer(out).bytes(hash_of(identity.own_hello_key_, {out}));
  assert(out.size() == kHelloBytes);
  return out;
}

bool Handshake::is_authentic(const Identity& identity, ByteView hello) {
  return hello.size() == kHelloBytes &&
         equal(hash_of(identity.peer_hello_key_, {without_mac(hello)}), hello.last(kMacBytes));
}

std::optional<Handshake::Answered> Handshake::answer(const Identity& identity, ByteView hello,
                                                     const KeyPair& ephemeral,
                                                     std::uint32_t session, std::int64_t wall_ns) {
  const std::optional<Hello> asked = read_hello(hello);
  if (!asked) return std::nullopt;
  Key es{}, se{}, ee{};
  if (!multiply(es, identity.own_.secret_key, asked->ephemeral) ||
      !multiply(se, ephemeral.secret_key, identity.peer_) ||
      !multiply(ee, ephemeral.secret_key, asked->ephemeral)) {
    return std::nullopt;
  }
  Answered out;
  out.answer = to_bytes(Answer{asked->session, session, wall_ns, ephemeral.public_key, {}});
  const Derived d = derive(identity.shared_, es, se, ee, hello, out.answer);
  const ByteView head = out.answer;
  const Mac cheap = hash_of(identity.own_answer_key_, {hello, head});
  Writer(out.answer)
      .bytes(ByteView(cheap).first(kHalfMacBytes))
      .bytes(ByteView(d.answer_mac).first(kHalfMacBytes));
  out.keys = {d.to_initiator, d.to_responder, session, asked->session};
  for (Key* secret : {&es, &se, &ee}) wipe(*secret);
  return out;
}

std::optional<SessionKeys> Handshake::finish(const Identity& identity, ByteView hello,
                                             const KeyPair& ephemeral, ByteView answer) {
  const std::optional<Answer> got = read_answer(answer);
  const std::optional<Hello> asked = read_hello(hello);
  if (!got || !asked || got->to_session != asked->session) return std::nullopt;
  const ByteView macs = answer.last(kMacBytes);
  const Mac cheap = hash_of(identity.peer_answer_key_, {hello, without_mac(answer)});
  if (!equal(macs.first(kHalfMacBytes), ByteView(cheap).first(kHalfMacBytes))) return std::nullopt;
  Key es{}, se{}, ee{};
  if (!multiply(es, ephemeral.secret_key, identity.peer_) ||
      !multiply(se, identity.own_.secret_key, got->ephemeral) ||
      !multiply(ee, ephemeral.secret_key, got->ephemeral)) {
    return std::nullopt;
  }
  const Derived d = derive(identity.shared_, es, se, ee, hello, without_mac(answer));
  for (Key* secret : {&es, &se, &ee}) wipe(*secret);
  if (!equal(macs.last(kHalfMacBytes), ByteView(d.answer_mac).first(kHalfMacBytes))) {
    return std::nullopt;
  }
  return SessionKeys{d.to_responder, d.to_initiator, got->to_session, got->session};
}

}  // namespace tether::link
