#pragma once

#include <chrono>
#include <cstdint>
#include <cstdio>
#include <deque>
#include <functional>
#include <lcm/lcm-cpp.hpp>
#include <map>
#include <optional>
#include <string>
#include <tether/pose_t.hpp>
#include <tether/time_grant_t.hpp>
#include <tether/time_join_t.hpp>
#include <tether/time_request_t.hpp>
#include <tether/time_resend_t.hpp>
#include <tether/time_welcome_t.hpp>
#include <tether/twist_t.hpp>
#include <utility>
#include <vector>

/// For controllers of other projects: what takes part in a run, live or in lockstep
/// (docs/reference/time.md), with nothing but LCM and the messages. A whole controller is
///
///   int main(int argc, char** argv) {
///     return tether::control(argc, argv, [](const tether::pose_t& pose, tether::twist_t& command)
///     {
///       command.v_mps = …;
///     });
///   }
///
/// started beside `tether run --processes SCENARIO` with controller.external = true and
/// `mine --lockstep --lcm-url URL`, or beside nodes in real time without --lockstep.
namespace tether {

/// The twist (v_mps, omega_radps) that answers a pose; all else of the command is filled in. Of two
/// poses that come in the wrong order, it gets the newer one only; none of the lead (utime < 0).
using PoseLaw = std::function<void(const pose_t& pose, twist_t& command)>;

/// A law at work on CTRL/POSE and CTRL/CMD_VEL. Not for several threads.
class LawClient {
 public:
  /// `lcm` must outlive this.
  LawClient(lcm::LCM& lcm, PoseLaw law, bool lockstep)
      : lcm_(lcm), law_(std::move(law)), lockstep_(lockstep) {
    lcm_.subscribe("CTRL/POSE", &LawClient::on_pose, this)->setQueueCapacity(1000);
    if (!lockstep) return;
    lcm_.subscribe("TIME/GRANT", &LawClient::on_grant, this)->setQueueCapacity(1000);
    lcm_.subscribe("TIME/WELCOME", &LawClient::on_welcome, this);
    lcm_.subscribe("TIME/RESEND", &LawClient::on_resend, this)->setQueueCapacity(1000);
  }

  /// Until the coordinator says that the run is over (true), or until it has been silent for 30 s
  /// or LCM fails (false). Live: for ever.
  bool run() {
    while (!left_ && lcm_.handleTimeout(50) >= 0) {
      if (heard_at_ != Clock::time_point{} && Clock::now() - heard_at_ > kCoordinatorPatience) {
        std::fprintf(stderr, "the coordinator has been silent for 30 s\n");
        return false;
      }
      if (!lockstep_ || Clock::now() - said_at_ < kRepeat) continue;
      if (session_ == 0) join();
      if (granted_) ask_again();
    }
    return left_;
  }

 private:
  using Bytes = std::vector<std::uint8_t>;
  using Clock = std::chrono::steady_clock;
  static constexpr auto kRepeat = std::chrono::milliseconds{100};
  static constexpr auto kCoordinatorPatience = std::chrono::seconds{30};

  /// Keyed BLAKE2b (RFC 7693) of 16 bytes, in hexadecimal. `key`: 32 bytes.
  static std::string keyed_hash(const Bytes& key, const Bytes& bytes) {
    static constexpr std::uint64_t kStart[8] = {
        0x6A09E667F3BCC908, 0xBB67AE8584CAA73B, 0x3C6EF372FE94F82B, 0xA54FF53A5F1D36F1,
        0x510E527FADE682D1, 0x9B05688C2B3E6C1F, 0x1F83D9ABFB41BD6B, 0x5BE0CD19137E2179};
    static constexpr std::uint8_t kOrder[10][16] = {
        {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15},
        {14, 10, 4, 8, 9, 15, 13, 6, 1, 12, 0, 2, 11, 7, 5, 3},
        {11, 8, 12, 0, 5, 2, 15, 13, 10, 14, 3, 6, 7, 1, 9, 4},
        {7, 9, 3, 1, 13, 12, 11, 14, 2, 6, 5, 10, 4, 0, 15, 8},
        {9, 0, 5, 7, 2, 4, 10, 15, 14, 1, 11, 12, 6, 8, 3, 13},
        {2, 12, 6, 10, 0, 11, 8, 3, 4, 13, 7, 5, 15, 14, 1, 9},
        {12, 5, 1, 15, 14, 13, 4, 10, 0, 7, 6, 3, 9, 2, 8, 11},
        {13, 11, 7, 14, 12, 1, 3, 9, 5, 0, 15, 4, 8, 6, 2, 10},
        {6, 15, 14, 9, 11, 3, 0, 8, 12, 2, 13, 7, 1, 4, 10, 5},
        {10, 2, 8, 4, 7, 6, 1, 5, 15, 11, 9, 14, 3, 12, 13, 0}};
    const auto right = [](std::uint64_t x, int by) { return x >> by | x << (64 - by); };
    Bytes data = key;
    data.resize(128);  // the key is a block of its own
    data.insert(data.end(), bytes.begin(), bytes.end());
    const std::size_t size = data.size();
    data.resize((size + 127) / 128 * 128);
    std::uint64_t h[8];
    for (int i = 0; i < 8; ++i) h[i] = kStart[i];
    h[0] ^= 0x01010000U ^ static_cast<std::uint64_t>(key.size()) << 8U ^ 16U;
    for (std::size_t at = 0; at < data.size(); at += 128) {
      std::uint64_t m[16] = {}, v[16];
      for (std::size_t i = 0; i < 128; ++i) {
        m[i / 8] |= static_cast<std::uint64_t>(data[at + i]) << 8 * (i % 8);
      }
      for (int i = 0; i < 8; ++i) v[i] = h[i], v[i + 8] = kStart[i];
      const bool last = at + 128 == data.size();
      v[12] ^= last ? size : at + 128;
      if (last) v[14] = ~v[14];
      for (int round = 0; round < 12; ++round) {
        const std::uint8_t* order = kOrder[round % 10];
        for (int i = 0; i < 8; ++i) {  // columns, then diagonals
          const int turn = i / 4;
          std::uint64_t& a = v[i % 4];
          std::uint64_t& b = v[4 + (i + turn) % 4];
          std::uint64_t& c = v[8 + (i + 2 * turn) % 4];
          std::uint64_t& d = v[12 + (i + 3 * turn) % 4];
          a += b + m[order[2 * i]];
          d = right(d ^ a, 32);
          c += d;
          b = right(b ^ c, 24);
          a += b + m[order[2 * i + 1]];
          d = right(d ^ a, 16);
          c += d;
          b = right(b ^ c, 63);
        }
      }
      for (int i = 0; i < 8; ++i) h[i] ^= v[i] ^ v[i + 8];
    }
    std::string hex;
    for (int i = 0; i < 16; ++i) {
      const auto byte = static_cast<unsigned>(h[i / 8] >> 8 * (i % 8)) & 0xFFU;
      hex += "0123456789abcdef"[byte / 16];
      hex += "0123456789abcdef"[byte % 16];
    }
    return hex;
  }

  /// Empty for anything but hexadecimal digits.
  static Bytes bytes_of_hex(const std::string& hex) {
    Bytes bytes;
    const std::string digits = "0123456789abcdef";
    for (std::size_t i = 0; i + 1 < hex.size(); i += 2) {
      const auto high = digits.find(hex[i]), low = digits.find(hex[i + 1]);
      if (high == std::string::npos || low == std::string::npos) return {};
      bytes.push_back(static_cast<std::uint8_t>(16 * high + low));
    }
    return bytes;
  }

  /// Digest of a grant or an answer: of all but its seq, which differs between copies, and the mac.
  template <class T>
  std::string mac_of(T message) const {
    message.seq = 0;
    message.mac.clear();
    return keyed_hash(node_key_, encoded(message));
  }

  template <class T>
  static Bytes encoded(const T& message) {
    Bytes bytes(static_cast<std::size_t>(message.getEncodedSize()));
    message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
    return bytes;
  }

  template <class T>
  static bool decode(const Bytes& bytes, T& message) {
    const int size = static_cast<int>(bytes.size());
    return message.decode(bytes.data(), 0, size) == size;
  }

  template <class T>
  Bytes publish(const std::string& channel, const T& message) {
    const Bytes bytes = encoded(message);
    lcm_.publish(channel, bytes.data(), static_cast<unsigned>(bytes.size()));
    return bytes;
  }

  /// Publishes the answer to a pose, decided at `utime` (none: not known, the pose's), and returns
  /// its bytes; none if the message is not a newer pose.
  Bytes command(const Bytes& bytes, std::optional<std::int64_t> utime) {
    tether::pose_t pose{};
    if (!decode(bytes, pose) || pose.seq <= newest_ || pose.utime < 0) return {};
    newest_ = pose.seq;
    tether::twist_t twist{};
    twist.utime = utime.value_or(pose.utime);
    twist.pose_utime = pose.utime;
    twist.run = pose.run;
    twist.seq = commands_++;
    law_(pose, twist);
    return publish("CTRL/CMD_VEL", twist);
  }

  void on_pose(const lcm::ReceiveBuffer* buffer, const std::string&) {
    const auto* data = static_cast<const std::uint8_t*>(buffer->data);
    const Bytes bytes(data, data + buffer->data_size);
    if (!lockstep_) {
      command(bytes, std::nullopt);
      return;
    }
    inbox_.push_back(bytes);  // until a grant names it
    if (inbox_.size() > 1000) inbox_.pop_front();
    carry_out();
  }

  void join() {
    said_at_ = Clock::now();
    tether::time_join_t join{};
    join.seq = seq_++;
    join.session = tether::time_join_t::ANY;
    join.instance = instance_;
    join.node = "controller";
    join.next_ns = join.next_order = INT64_MAX;  // no events of its own
    join.subscription = {"CTRL/POSE"};
    join.count = 1;
    publish("TIME/JOIN", join);
  }

  void on_welcome(const lcm::ReceiveBuffer* buffer, const std::string&) {
    heard_at_ = Clock::now();
    tether::time_welcome_t welcome{};
    if (welcome.decode(buffer->data, 0, static_cast<int>(buffer->data_size)) < 0) return;
    const bool mine = welcome.node == "controller" && welcome.instance == instance_;
    if (!mine || session_ != 0) return;
    session_ = welcome.session;
    run_key_ = bytes_of_hex(welcome.run_key);
    node_key_ = bytes_of_hex(welcome.node_key);
  }

  void on_grant(const lcm::ReceiveBuffer* buffer, const std::string&) {
    heard_at_ = Clock::now();
    tether::time_grant_t grant{};
    if (grant.decode(buffer->data, 0, static_cast<int>(buffer->data_size)) < 0) return;
    const bool mine = grant.node == "controller" && session_ != 0 && grant.session == session_;
    if (!mine || grant.mac != mac_of(grant)) return;
    if (grant.id == answered_) publish("TIME/REQUEST", answer_);  // it was lost
    if (grant.id <= answered_ || granted_) return;
    left_ = grant.kind == tether::time_grant_t::LEAVE;
    if (left_) return;
    grant_ = grant;
    granted_ = true;
    answer_ = {};
    said_at_ = Clock::now();
    carry_out();
  }

  /// Takes the grant's messages in their order, as far as they have come; answers after the last.
  void carry_out() {
    while (granted_ && next_ < static_cast<std::size_t>(grant_.count)) {
      auto pose = inbox_.begin();
      while (pose != inbox_.end() &&
             (static_cast<std::int64_t>(pose->size()) != grant_.size[next_] ||
              keyed_hash(run_key_, *pose) != grant_.digest[next_])) {
        ++pose;
      }
      if (pose == inbox_.end()) return;
      const Bytes sent = command(*pose, grant_.time_ns[next_] / 1000);
      inbox_.erase(pose);
      if (!sent.empty()) {
        sent_[commands_] = sent;
        answer_.channel.emplace_back("CTRL/CMD_VEL");
        answer_.number.push_back(commands_);
        answer_.time_ns.push_back(grant_.time_ns[next_]);
        answer_.index.push_back(static_cast<std::int64_t>(next_));
        answer_.size.push_back(static_cast<std::int64_t>(sent.size()));
        answer_.digest.push_back(keyed_hash(run_key_, sent));
      }
      ++next_;
    }
    if (!granted_) return;
    answer_.seq = seq_++;
    answer_.session = session_;
    answer_.instance = instance_;
    answer_.grant = answered_ = grant_.id;
    answer_.grant_mac = grant_.mac;
    answer_.node = "controller";
    answer_.next_ns = answer_.next_order = INT64_MAX;
    answer_.count = static_cast<std::int32_t>(answer_.channel.size());
    answer_.mac = mac_of(answer_);
    granted_ = false;
    next_ = 0;
    publish("TIME/REQUEST", answer_);
  }

  void ask_again() {
    said_at_ = Clock::now();
    tether::time_resend_t message{};
    message.seq = seq_++;
    message.session = session_;
    message.publisher = grant_.publisher[next_];
    message.channel = grant_.channel[next_];
    message.number = grant_.number[next_];
    publish("TIME/RESEND", message);
  }

  void on_resend(const lcm::ReceiveBuffer* buffer, const std::string&) {
    tether::time_resend_t message{};
    if (message.decode(buffer->data, 0, static_cast<int>(buffer->data_size)) < 0) return;
    const auto found = sent_.find(message.number);
    const bool ours = message.session == session_ && message.publisher == "controller";
    if (!ours || message.channel != "CTRL/CMD_VEL" || found == sent_.end()) return;
    lcm_.publish("CTRL/CMD_VEL", found->second.data(), static_cast<unsigned>(found->second.size()));
  }

  lcm::LCM& lcm_;
  PoseLaw law_;
  bool lockstep_;
  /// A number that tells this start of the program from any other.
  const std::int64_t instance_ = std::chrono::system_clock::now().time_since_epoch().count();
  bool left_ = false;
  std::int64_t newest_ = -1;   // pose
  std::int64_t commands_ = 0;  // so far
  std::int64_t seq_ = 0;
  std::int64_t session_ = 0;
  Bytes run_key_, node_key_;  ///< key of digests; key of this node's grants and answers
  std::deque<Bytes> inbox_;
  std::map<std::int64_t, Bytes> sent_;  // by number, to send again
  bool granted_ = false;                // grant_ is being carried out …
  tether::time_grant_t grant_{};
  std::size_t next_ = 0;       // … and has come to this message
  std::int64_t answered_ = 0;  // grant
  tether::time_request_t answer_{};
  Clock::time_point said_at_{}, heard_at_{};
};

/// A controller's main(): [--lcm-url URL] [--lockstep]. 0 after a run, 1 if something went wrong, 2
/// for other arguments.
inline int control(int argc, char** argv, PoseLaw law) {
  std::string url = "udpm://239.255.76.67:7667?ttl=0";
  bool lockstep = false;
  for (int i = 1; i < argc; ++i) {
    const std::string argument = argv[i];
    if (argument == "--lockstep") {
      lockstep = true;
    } else if (argument == "--lcm-url" && i + 1 < argc) {
      url = argv[++i];
    } else {
      std::fprintf(stderr, "usage: %s [--lcm-url URL] [--lockstep]\n", argv[0]);
      return 2;
    }
  }
  lcm::LCM lcm(url);
  if (!lcm.good()) {
    std::fprintf(stderr, "LCM does not open \"%s\"\n", url.c_str());
    return 1;
  }
  return LawClient(lcm, std::move(law), lockstep).run() ? 0 : 1;
}

}  // namespace tether
