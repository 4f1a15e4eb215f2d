#include "netem/stages/rate.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <deque>

#include "netem/stages/duplicate.hpp"
#include "netem/stages/kinds.hpp"

namespace tether {
namespace {

/// A bottleneck of constant bit rate with a first-in-first-out queue in front of it. A packet of n
/// bytes takes 8 (n + overhead)/rate seconds, rounded to 1 ns, once those before it are through. It
/// is dropped if it would be one packet or byte too many among those not yet through (tail drop).
class RateLimit final : public LinkStage {
 public:
  using Settings = RateSettings;

  RateLimit(const RateSettings& settings, const LinkStreams&) : settings_(settings) {}

  /// Another rate and queue for packets from now on; those that wait stay as they are.
  void set(const RateSettings& settings) { settings_ = settings; }

  bool pass(Passage& passage) override {
    while (!waiting_.empty() && waiting_.front().through <= passage.now) {
      waiting_bytes_ -= waiting_.front().bytes;
      waiting_.pop_front();
    }
    const std::int64_t length = static_cast<std::int64_t>(passage.bytes) + settings_.overhead_bytes;
    if (static_cast<std::int64_t>(waiting_.size()) >= settings_.queue_packets ||
        (settings_.queue_bytes > 0 && waiting_bytes_ + length > settings_.queue_bytes)) {
      return false;
    }
    constexpr double kLongest_s = 1e6;
    const double seconds = 8.0 * static_cast<double>(length) / settings_.bits_per_s;
    free_from_ = std::max(passage.now, free_from_) + from_seconds(std::min(kLongest_s, seconds));
    waiting_.push_back({free_from_, length});
    waiting_bytes_ += length;
    passage.sent = free_from_;
    return true;
  }

 private:
  struct Waiting {
    Instant through;
    std::int64_t bytes;
  };
  RateSettings settings_;
  std::deque<Waiting> waiting_;  // at most queue_packets
  std::int64_t waiting_bytes_ = 0;
  Instant free_from_ = Instant::min();
};

const RateSettings& of(const LinkConfig& link) { return link.own.get<RateSettings>(); }

std::vector<ScenarioKey> keys(const LinkField& field) {
  auto t = field.keys_of<RateSettings>("rate");
  t.number("bits_per_s", &RateSettings::bits_per_s, {0.0, 1e12, false},
           "bit rate of the bottleneck; 0 = no limit");
  t.whole_number(
      "queue_packets", &RateSettings::queue_packets, 1,
      "maximum number of packets that wait for the bottleneck or pass it; more are dropped");
  t.whole_number("queue_bytes", &RateSettings::queue_bytes, 0,
                 "maximum number of bytes that wait for the bottleneck or pass it; 0 = no limit");
  t.whole_number("overhead_bytes", &RateSettings::overhead_bytes, 0,
                 "bytes added to each packet's length");
  return t.take();
}

void expect(const LinkConfig& link, const LinkTraffic& traffic, StageEffects& effects) {
  const RateSettings& rate = of(link);
  if (rate.bits_per_s <= 0.0) return;
  const double bytes = traffic.packet_bytes + static_cast<double>(rate.overhead_bytes);
  effects.service_s = 8.0 * bytes / rate.bits_per_s;
  if (!traffic.periodic) {
    effects.no_delays = "packets come irregularly and wait for each other at the rate limit";
  } else if (link.own.get<DuplicateSettings>().probability > 0.0) {
    effects.no_delays = "packets wait for copies at the rate limit";
  } else if (effects.service_s > traffic.interval_s) {
    effects.no_delays = "packets come faster than the rate limit lets them through";
  }
}

void export_tc(const LinkConfig& link, const TcSender& sender, TcDraft& out) {
  if (of(link).bits_per_s <= 0.0) return;
  const double headers = frame_overhead_bytes(sender.channel);
  const double overhead = static_cast<double>(of(link).overhead_bytes) - headers;
  out.command += fmt::format(" rate {:.0f}bit {:.0f}", of(link).bits_per_s, overhead);
  out.notes.push_back(
      fmt::format("rate: tc counts Ethernet, IP, UDP and LCM headers ({:.0f} bytes with {}), which "
                  "the overhead of {:.0f} takes off again",
                  headers, sender.channel, overhead));
  if (!out.delays_vary) return;
  out.notes.emplace_back(
      "rate: netem's bottleneck lies behind the delay and lets none overtake; Tether's lies "
      "before it, and packets overtake each other when delays fall");
}

}  // namespace

LinkStageKind rate_stage() {
  LinkStageKind kind{.name = "rate"};
  kind.on = [](const LinkConfig& link) { return of(link).bits_per_s > 0.0; };
  kind.make = [](const StageNeeds& needs) { return needs.go_on<RateLimit>(); };
  kind.keys = keys;
  kind.switch_key = "rate.bits_per_s";
  kind.expect = expect;
  kind.export_tc = export_tc;
  kind.tc_part = TcPart::rate;
  return kind;
}

}  // namespace tether
