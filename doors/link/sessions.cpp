#include "doors/link/sessions.hpp"

#include <sodium.h>

#include <algorithm>
#include <cassert>
#include <cstdlib>
#include <utility>

namespace tether::link {

bool ReplayWindow::is_marked(std::uint64_t counter) const {
  return (words_[counter / kWordBits % kWords] >> (counter % kWordBits) & 1) != 0;
}

ReplayWindow::Verdict ReplayWindow::look(std::uint64_t counter) const {
  if (!any_ || counter > newest_) return Verdict::fresh;
  if (newest_ - counter >= kSize) return Verdict::too_old;
  return is_marked(counter) ? Verdict::seen : Verdict::fresh;
}

void ReplayWindow::mark(std::uint64_t counter) {
  if (look(counter) == Verdict::too_old) return;
  if (!any_ || counter > newest_) {
    const std::uint64_t from = any_ ? newest_ / kWordBits : counter / kWordBits;
    const std::uint64_t words = std::min(counter / kWordBits - from, kWords);
    for (std::uint64_t i = 0; i < words; ++i) words_[(counter / kWordBits - i) % kWords] = 0;
    newest_ = counter;
    any_ = true;
  }
  words_[counter / kWordBits % kWords] |= std::uint64_t{1} << (counter % kWordBits);
}

std::uint64_t ReplayWindow::newest_bits() const {
  std::uint64_t bits = 0;
  for (std::uint64_t i = 0; any_ && i < kWordBits && i <= newest_; ++i) {
    if (is_marked(newest_ - i)) bits |= std::uint64_t{1} << i;
  }
  return bits;
}

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

Sessions::Sessions(const Identity& identity, std::uint8_t number, const RekeySettings& rekey,
                   RandomKey random, Refusals& refused)
    : identity_(identity),
      number_(number),
      rekey_(rekey),
      random_(std::move(random)),
      refused_(refused) {}

std::uint32_t Sessions::new_number() {
  for (;;) {
    const std::uint32_t number = (Reader(random_()).number<std::uint32_t>() & ~0xFFU) | number_;
    if (find(number) == nullptr && !(started_ && started_->number == number)) return number;
  }
}

KeyPair Sessions::new_pair() {
  Key seed = random_();
  const KeyPair pair = key_pair_of(seed);
  wipe(seed);
  return pair;
}

bool Sessions::take(const Hello& hello, Instant now) {
  // After that any HELLO of an allowed time is newer.
  constexpr Duration kLongEnough = 2 * kMostClockDifference + std::chrono::seconds{5};
  if (newest_hello_ && now - newest_hello_->when > kLongEnough) newest_hello_.reset();
  if (newest_hello_ && hello.wall_ns <= newest_hello_->wall_ns) return false;
  newest_hello_ = Taken{hello.wall_ns, now};
  return true;
}

std::optional<ByteView> Sessions::on_hello(ByteView hello, Moment m) {
  const std::optional<Hello> asked = read_hello(hello);
  if (!asked || !Handshake::is_authentic(identity_, hello)) {
    ++refused_.forged;
    return std::nullopt;
  }
  if (answered_ && answered_hello_ == asked->mac) {
    if (++answers_ <= kMostAnswers) return answer_;
    ++refused_.replayed;
    return std::nullopt;
  }
  constexpr std::int64_t kMost_ns = Duration{kMostClockDifference}.count();
  if (asked->wall_ns < m.wall_ns - kMost_ns || asked->wall_ns > m.wall_ns + kMost_ns) {
    ++refused_.clock;
    clock_ahead_ns_ = static_cast<std::int64_t>(static_cast<std::uint64_t>(asked->wall_ns) -
                                                static_cast<std::uint64_t>(m.wall_ns));
    return std::nullopt;
  }
  if (!take(*asked, m.now)) {
    // By the second path, when the first has brought answer and confirmation already.
    if (!(current_ && answered_hello_ == asked->mac)) ++refused_.replayed;
    return std::nullopt;
  }
  auto answered = Handshake::answer(identity_, hello, new_pair(), new_number(), m.wall_ns);
  if (!answered) {
    ++refused_.forged;
    return std::nullopt;
  }
  answered_ = std::make_unique<Session>(answered->keys, false, m.now);
  wipe(answered->keys.send);
  wipe(answered->keys.receive);
  answered_hello_ = asked->mac;
  answers_ = 1;
  answer_ = std::move(answered->answer);
  return answer_;
}

bool Sessions::on_answer(ByteView answer, Moment m) {
  const std::optional<Answer> got = read_answer(answer);
  if (got && current_ && current_->initiated() && got->to_session == current_->own_number()) {
    return false;  // it came by the other path before
  }
  if (!got || !started_ || got->to_session != started_->number) {
    ++refused_.no_session;
    return false;
  }
  std::optional<SessionKeys> keys =
      Handshake::finish(identity_, started_->hello, started_->ephemeral, answer);
  if (!keys) {
    ++refused_.forged;
    return false;
  }
  install(std::make_unique<Session>(*keys, true, m.now), m.now);
  wipe(keys->send);
  wipe(keys->receive);
  return true;
}

Session* Sessions::find(std::uint32_t number) {
  for (const auto* session : {&current_, &previous_, &answered_}) {
    if (*session && (*session)->own_number() == number) return session->get();
  }
  return nullptr;
}

bool Sessions::confirm(Session& session, Instant now) {
  if (session.generation() == 0) session.begin_generation(++generations_);
  if (&session == current_.get()) {
    current_heard_ = now;
    disagree_ = false;
  } else if (&session == previous_.get()) {
    previous_end_ = now + kPreviousLife;
    const bool yields = identity_.peer() < identity_.own().public_key;
    disagree_ = now - current_heard_ > (yields ? kDisagreement : 3 * kDisagreement);
  }
  if (&session != answered_.get()) return false;
  install(std::move(answered_), now);
  return true;
}

void Sessions::install(std::unique_ptr<Session> session, Instant now) {
  // Both began at once: the peer's HELLO was answered before ours was.
  const bool keep = current_ && current_->initiated() && !session->initiated() &&
                    session->begin() <= current_->begin() &&
                    identity_.own().public_key < identity_.peer();
  previous_ = keep ? std::move(session) : std::exchange(current_, std::move(session));
  previous_end_ = now + kPreviousLife;
  current_heard_ = now;
  disagree_ = false;
  started_.reset();
  next_hello_.reset();
  wait_ = kFirstWait;
  ++count_;
}

bool Sessions::wants_new_keys(Instant now) const {
  if (!current_ || disagree_) return true;
  // The other side only if the initiator of the session does not.
  const Duration age = now - current_->begin();
  return age >= (current_->initiated() ? rekey_.after : rekey_.after + rekey_.after / 8) ||
         current_->next_counter() >= rekey_.datagrams;
}

std::optional<ByteView> Sessions::due_hello(Moment m, bool wanted) {
  if (previous_ && (m.now >= previous_end_ || m.now - previous_->begin() > 2 * rekey_.after)) {
    previous_.reset();
  }
  if (answered_ && m.now - answered_->begin() > kAnsweredLife) answered_.reset();
  if (current_ && m.now - current_->begin() > 2 * rekey_.after) current_.reset();
  if (!wanted && !wants_new_keys(m.now)) {
    next_hello_.reset();
    started_.reset();
    wait_ = kFirstWait;
    return std::nullopt;
  }
  if (next_hello_ && m.now < *next_hello_) return std::nullopt;
  started_ = Started{new_pair(), new_number(), {}};
  started_->hello = Handshake::hello(identity_, started_->ephemeral, started_->number, m.wall_ns);
  next_hello_ = m.now + wait_;
  wait_ = std::min<Duration>(2 * wait_, kLongestWait);
  return started_->hello;
}

}  // namespace tether::link
