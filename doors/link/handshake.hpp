#pragma once

#include <cstdint>
#include <optional>

#include "doors/link/key_pair.hpp"
#include "doors/link/wire.hpp"

namespace tether::link {

// How two hosts that know each other's public keys agree on the keys of a session, in two
// datagrams: Noise's pattern KK (noiseprotocol.org, revision 34), with libsodium's X25519 and
// BLAKE2b. With static keys a, b and ephemeral keys x, y of initiator and responder:
//
//   ss = DH(a, b)   authenticates HELLO and ANSWER, cheaply: no Diffie-Hellman is computed for an
//   unknown key es = DH(x, b), se = DH(a, y), ee = DH(x, y) master = BLAKE2b(ss, es, se, ee, HELLO,
//   ANSWER without MAC)
//
// What that gives:
// - The session's keys need an ephemeral key of each side: a static key that is stolen later opens
//   no recording (forward secrecy).
// - A thief of a host's static key can pass for that host, but cannot pass for others towards
// it:
//   es and se need the other one's static key, or an ephemeral one of its making. (He can make a
//   HELLO that it answers; the session's first sealed datagram is then missing.)
// - The whole transcript is in the keys, version bytes included.
// - The responder proves itself by the ANSWER's MAC, the initiator by its first sealed datagram.
//   Until then a responder must not send in the session, nor give up another for it.
//
// Nothing here remembers: PeerLink refuses a HELLO that came before.

/// One side's view of a pair of hosts: what the two static keys give, computed once.
class Identity {
 public:
  /// Throws UsageError if `peer` is no key (a point of low order), or `own`.
  Identity(const KeyPair& own, const Key& peer);

  const KeyPair& own() const { return own_; }
  const Key& peer() const { return peer_; }

 private:
  friend class Handshake;

  KeyPair own_;
  Key peer_;
  Key shared_{};         // ss
  Key own_hello_key_{};  // key of the HELLOs that this host makes
  Key peer_hello_key_{};
  Key own_answer_key_{};
  Key peer_answer_key_{};
};

/// The two directions of a session. Counters begin with 0.
struct SessionKeys {
  Key send{};
  Key receive{};
  std::uint32_t own_session = 0;   ///< under which we hear
  std::uint32_t peer_session = 0;  ///< under which the peer hears
};

/// Ephemeral keys are to be used once: each call gets a pair made for it.
class Handshake {
 public:
  static Bytes hello(const Identity& identity, const KeyPair& ephemeral, std::uint32_t session,
                     std::int64_t wall_ns);
  /// Whether one of the two hosts made it, and not we. `hello`: what read_hello() takes.
  static bool is_authentic(const Identity& identity, ByteView hello);

  struct Answered {
    Bytes answer;
    SessionKeys keys;
  };
  /// To an authentic HELLO; nullopt: its ephemeral key is none.
  static std::optional<Answered> answer(const Identity& identity, ByteView hello,
                                        const KeyPair& ephemeral, std::uint32_t session,
                                        std::int64_t wall_ns);
  /// `hello` and `ephemeral`: of ours. nullopt: `answer` is not the peer's to this HELLO.
  static std::optional<SessionKeys> finish(const Identity& identity, ByteView hello,
                                           const KeyPair& ephemeral, ByteView answer);
};

}  // namespace tether::link
