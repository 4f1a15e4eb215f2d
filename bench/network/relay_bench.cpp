#include <benchmark/benchmark.h>
#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <ctime>
#include <map>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "bench/network/live_relay.hpp"
#include "bench/run.hpp"
#include "bench/samples.hpp"
#include "bench/smoke.hpp"
#include "bench/timing.hpp"

// tether-netem --rule as a process between two real LCM networks, beside plain LCM and a bare
// forwarder in the same run.
// Needs a multicast route: tests/support/in_own_network.sh. It reports, and fails only if nothing
// is measured.

namespace tether {
namespace {

using bench::LiveRelay;
using bench::median;
using bench::Samples;
using bench::Way;
using std::chrono::milliseconds;
using std::chrono::seconds;

/// Maximum number of messages under way: 64 of 300 kB would overflow the sockets.
std::uint32_t window(std::size_t bytes) { return bytes > 10'000 ? 4 : 64; }

/// Messages per second from publishing to handling, with no more than a window under way.
class Throughput {
 public:
  Throughput(LiveRelay& relay, Way way, std::size_t bytes)
      : relay_(relay), way_(way), bytes_(bytes), window_(window(bytes)) {
    relay_.on_heard(way_, [this](std::uint32_t number, std::int64_t) { on_heard(number); });
  }
  ~Throughput() { relay_.on_heard(way_, nullptr); }
  Throughput(const Throughput&) = delete;
  Throughput& operator=(const Throughput&) = delete;

  double per_s(Duration time) {
    const std::int64_t start_ns = LiveRelay::now_ns();
    std::uint32_t before = 0;
    going_ = true;
    const Instant end = relay_.loop().now() + time;
    while (relay_.loop().now() < end) {
      fill();
      relay_.run_for(std::min<Duration>(milliseconds{200}, end - relay_.loop().now()));
      if (next_ == before) skip();
      before = next_;
    }
    const double elapsed_s = static_cast<double>(LiveRelay::now_ns() - start_ns) * 1e-9;
    const std::uint32_t heard = heard_;
    going_ = false;
    relay_.run_for(milliseconds{300}, [this] { return next_ == sent_; });
    skip();
    return heard / elapsed_s;
  }
  std::uint32_t lost() const { return lost_; }
  std::uint32_t heard() const { return heard_; }

 private:
  /// Counts missing messages as lost.
  void skip() {
    lost_ += sent_ - next_;
    next_ = sent_;
  }
  void on_heard(std::uint32_t number) {
    lost_ += number - next_;
    next_ = number + 1;
    ++heard_;
    fill();
  }
  void fill() {
    while (going_ && sent_ - next_ < window_) {
      relay_.send(way_, sent_, bytes_);
      ++sent_;
    }
  }

  LiveRelay& relay_;
  Way way_;
  std::size_t bytes_;
  std::uint32_t window_;
  bool going_ = false;
  std::uint32_t sent_ = 0;
  std::uint32_t next_ = 0;  // to be heard
  std::uint32_t heard_ = 0;
  std::uint32_t lost_ = 0;
};

/// The three ways in turn; medians.
void throughput(benchmark::State& state) {
  const auto bytes = static_cast<std::size_t>(state.range(0));
  for (auto unused : state) {
    (void)unused;
    LiveRelay relay({});
    std::vector<double> plain, bare, relayed, over_plain, over_bare;
    double lost = 0.0, messages = 0.0, cpu_s = 0.0;
    const auto measure = [&](Way way, std::vector<double>& per_s) {
      Throughput direction(relay, way, bytes);
      const double cpu_before_s = relay.cpu_s();
      per_s.push_back(direction.per_s(seconds{1}));
      lost += direction.lost();
      if (way != Way::relayed) return;
      messages += direction.heard();
      cpu_s += relay.cpu_s() - cpu_before_s;
    };
    for (int i = 0; i < bench::rounds(7); ++i) {
      measure(Way::plain, plain);
      measure(Way::bare, bare);
      measure(Way::relayed, relayed);
      over_plain.push_back(relayed.back() / plain.back());
      over_bare.push_back(relayed.back() / bare.back());
    }
    if (median(relayed) <= 0.0) throw std::runtime_error("nothing was relayed");
    state.SetIterationTime(1.0 / median(relayed));
    state.counters["plain_per_s"] = median(plain);
    state.counters["bare_per_s"] = median(bare);
    state.counters["relayed_per_s"] = median(relayed);
    state.counters["over_plain"] = median(over_plain);
    state.counters["over_bare"] = median(over_bare);
    state.counters["relay_cpu_us"] = 1e6 * cpu_s / messages;
    state.counters["lost"] = lost;
  }
}

/// How late a bare thread wakes that sleeps until every full millisecond.
class Sleeper {
 public:
  Sleeper() : thread_([this] { run(); }) {}
  ~Sleeper() { lateness(); }
  Sleeper(const Sleeper&) = delete;
  Sleeper& operator=(const Sleeper&) = delete;

  /// Ends it.
  Samples& lateness() {
    done_ = true;
    if (thread_.joinable()) thread_.join();
    return lateness_;
  }

 private:
  void run() {
    std::int64_t due_ns = LiveRelay::now_ns();
    while (!done_) {
      due_ns += 1'000'000;
      const timespec due{due_ns / 1'000'000'000, due_ns % 1'000'000'000};
      clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, nullptr);
      const std::int64_t now_ns = LiveRelay::now_ns();
      lateness_.add(now_ns - due_ns);
      due_ns = std::max(due_ns, now_ns - 1'000'000);
    }
  }

  std::atomic<bool> done_{false};
  Samples lateness_;
  std::thread thread_;
};

/// At 1 kHz: a hop (from publishing to handling, no relay) and the relayed way.
struct Latencies {
  Samples hop;
  Samples relayed;  ///< from publishing to handling on the other network
  Samples added;    ///< from handling on the first network to handling on the other
  Samples sleeper;
};

Latencies measure_latencies(double delay_ms) {
  Sleeper sleeper;
  Latencies result;
  std::map<std::uint32_t, std::int64_t> sent, near;
  std::uint32_t number = 0;
  bool sending = true;
  LiveRelay relay({fmt::format("channel.uplink.delay_ms={}", delay_ms)});
  relay.on_near([&](std::uint32_t number, std::int64_t when_ns) {
    near[number] = when_ns;
    result.hop.add(when_ns - sent[number]);
  });
  relay.on_heard(Way::relayed, [&](std::uint32_t number, std::int64_t when_ns) {
    result.relayed.add(when_ns - sent[number]);
    if (near.contains(number)) result.added.add(when_ns - near[number]);
  });
  // The period does not divide the delay, so that departures and arrivals do not always coincide.
  constexpr std::chrono::microseconds kPeriod{1030};
  relay.loop().every(relay.loop().now(), kPeriod, Priority::node, [&](Instant) {
    if (!sending) return;
    sent[number] = LiveRelay::now_ns();
    relay.send(Way::relayed, number++, 100);
  });
  relay.run_for(bench::window(seconds{10}));
  sending = false;
  relay.run_for(milliseconds{200});
  relay.on_near(nullptr);
  relay.on_heard(Way::relayed, nullptr);
  result.sleeper = sleeper.lateness();
  return result;
}

void latency(benchmark::State& state) {
  const auto delay_ms = static_cast<double>(state.range(0));
  for (auto unused : state) {
    (void)unused;
    Latencies l = measure_latencies(delay_ms);
    if (l.added.size() == 0) throw std::runtime_error("nothing was relayed");
    state.SetIterationTime(l.relayed.percentile_ms(0.5) * 1e-3);
    state.counters["hop_p50_ms"] = l.hop.percentile_ms(0.5);
    state.counters["hop_p99_ms"] = l.hop.percentile_ms(0.99);
    state.counters["added_p50_ms"] =
        l.relayed.percentile_ms(0.5) - l.hop.percentile_ms(0.5) - delay_ms;
    state.counters["error_p50_ms"] = l.added.percentile_ms(0.5) - delay_ms;
    state.counters["error_p99_ms"] = l.added.percentile_ms(0.99) - delay_ms;
    state.counters["sleep_p50_ms"] = l.sleeper.percentile_ms(0.5);
    state.counters["sleep_p99_ms"] = l.sleeper.percentile_ms(0.99);
    state.counters["samples"] = static_cast<double>(l.added.size());
  }
}

BENCHMARK(throughput)
    ->ArgName("bytes")
    ->Arg(100)
    ->Arg(10'000)
    ->Arg(300'000)
    ->Iterations(1)
    ->UseManualTime()
    ->Unit(benchmark::kMicrosecond);
BENCHMARK(latency)
    ->ArgName("delay_ms")
    ->Arg(0)
    ->Arg(10)
    ->Iterations(1)
    ->UseManualTime()
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace tether

int main(int argc, char** argv) { return tether::bench::run_benchmarks(argc, argv); }
