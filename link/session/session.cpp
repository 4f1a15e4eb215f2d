#include "link/session/session.hpp"

#include <sodium.h>

#include <cassert>

namespace tether::link {
namespace {

static_assert(crypto_aead_chacha20poly1305_ietf_KEYBYTES == sizeof(Key));
static_assert(crypto_aead_chacha20poly1305_ietf_ABYTES == kTagBytes);

using Nonce = std::array<std::uint8_t, crypto_aead_chacha20poly1305_ietf_NPUBBYTES>;

/// Four zeros, then the counter, its least significant byte first (as Noise has it).
Nonce nonce_of(std::uint64_t counter) {
  Nonce nonce{};
  for (std::size_t i = 0; i < sizeof counter; ++i) {
    nonce[4 + i] = static_cast<std::uint8_t>(counter >> (8 * i));
  }
  return nonce;
}

bool decrypt(Bytes& text, const SealedHeader& header, ByteView datagram, const Key& key) {
  const ByteView sealed = datagram.subspan(kSealedHeaderBytes);
  const Nonce nonce = nonce_of(header.counter);
  return crypto_aead_chacha20poly1305_ietf_decrypt(
             text.data(), nullptr, nullptr, sealed.data(), sealed.size(), datagram.data(),
             kSealedHeaderBytes, nonce.data(), key.data()) == 0;
}

}  // namespace

bool Session::is_authentic(const SealedHeader& header, ByteView datagram) const {
  Bytes text(datagram.size() - kSealedHeaderBytes - kTagBytes);
  return decrypt(text, header, datagram, keys_.receive);
}

Session::Session(const SessionKeys& keys, bool initiated, Instant begin)
    : keys_(keys), initiated_(initiated), begin_(begin) {}

Session::~Session() {
  sodium_memzero(keys_.send.data(), keys_.send.size());
  sodium_memzero(keys_.receive.data(), keys_.receive.size());
}

std::uint64_t Session::seal(ByteView text, Bytes& datagram) {
  assert(counter_ < UINT64_MAX);  // a session ends long before
  datagram.clear();
  append(datagram, {keys_.peer_session, counter_});
  datagram.resize(kSealedHeaderBytes + text.size() + kTagBytes);
  const Nonce nonce = nonce_of(counter_);
  crypto_aead_chacha20poly1305_ietf_encrypt(
      datagram.data() + kSealedHeaderBytes, nullptr, text.data(), text.size(), datagram.data(),
      kSealedHeaderBytes, nullptr, nonce.data(), keys_.send.data());
  return counter_++;
}

Opened Session::open(std::size_t path, const SealedHeader& header, ByteView datagram, Bytes& text) {
  assert(path < kMostPaths && datagram.size() >= kSealedHeaderBytes + kTagBytes);
  ReplayWindow& on_path = path_windows_[path];
  if (on_path.look(header.counter) != ReplayWindow::Verdict::fresh) return Opened::replayed;
  text.resize(datagram.size() - kSealedHeaderBytes - kTagBytes);
  if (!decrypt(text, header, datagram, keys_.receive)) return Opened::forged;
  on_path.mark(header.counter);
  ++counts_[path].received;
  const ReplayWindow::Verdict verdict = window_.look(header.counter);
  if (verdict == ReplayWindow::Verdict::seen) return Opened::duplicate;
  if (verdict == ReplayWindow::Verdict::too_old) return Opened::late;
  window_.mark(header.counter);
  return Opened::fresh;
}

}  // namespace tether::link
