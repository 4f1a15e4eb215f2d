#include <benchmark/benchmark.h>
#include <fmt/format.h>
#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstring>
#include <ctime>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "bench/cpu_time.hpp"
#include "bench/network/bare_forwarder.hpp"
#include "bench/run.hpp"
#include "bench/samples.hpp"
#include "bench/smoke.hpp"
#include "bench/timing.hpp"
#include "common/base/share.hpp"
#include "common/lcm/lcm_url.hpp"
#include "common/lcm/udpm_bus.hpp"
#include "common/node/real_time_loop.hpp"
#include "doors/link/key_file.hpp"
#include "doors/link/sessions.hpp"
#include "tests/link/two_hosts.hpp"
#include "tests/support/folder.hpp"
#include "tools/base/process.hpp"
#include "tools/nodes/node_process.hpp"

// Cost of tether-link: sealing and opening; and two processes between two LCM networks over
// loopback, beside two bare UDP forwarders in the same run.
// Needs a multicast route: tests/support/in_own_network.sh. It reports, and fails only if nothing
// is measured.

namespace tether {
namespace {

using bench::median;
using bench::Samples;
using link::Bytes;
using std::chrono::milliseconds;
using std::chrono::seconds;

void seal_and_open(benchmark::State& state) {
  const link::SessionKeys ab{link::testing::key_number(1), link::testing::key_number(2), 1, 2};
  link::Session a(ab, true, kStart), b({ab.receive, ab.send, 2, 1}, false, kStart);
  const Bytes text(static_cast<std::size_t>(state.range(0)), 7);
  Bytes datagram, opened;
  for (auto unused : state) {
    (void)unused;
    a.seal(text, datagram);
    const auto header = link::read_sealed_header(datagram);
    if (b.open(0, *header, datagram, opened) != link::Opened::fresh) {
      throw std::runtime_error("not opened");
    }
  }
}

std::int64_t now_ns() {
  timespec t{};
  clock_gettime(CLOCK_MONOTONIC, &t);
  return t.tv_sec * 1'000'000'000LL + t.tv_nsec;
}

std::string url_of(int port) {
  return checked_lcm_url(fmt::format("udpm://239.255.76.67:{}?ttl=0", port));
}

/// How messages go from one LCM network to another: by two bare forwarders with a network between
/// them, or by two tether-links.
enum class Way : std::uint8_t { bare, linked };

class LiveLink {
 public:
  using Heard = std::function<void(std::uint32_t number, std::int64_t when_ns)>;

  explicit LiveLink(std::size_t paths) : loop_(RealTimeLoop::wall_utime_us()) {
    for (Line& line : lines_) {
      line.in.subscribe("DATA", kDeepQueue, [&line](const Message& message) {
        std::uint32_t number = 0;
        std::memcpy(&number, message.bytes.data(), std::min(sizeof number, message.bytes.size()));
        if (line.heard) line.heard(number, now_ns());
      });
    }
    for (const std::string side : {"near", "far"}) {
      link::write_key_file((folder_.path / (side + ".key")).string(), keys(side));
    }
    start("near", 7667, 7700, paths);
    start("far", 7668, 7710, paths);
    run_for(seconds{10}, [this] { return up_ == 2; });
    if (up_ < 2) throw std::runtime_error("the link does not come up\n" + said_);
  }
  ~LiveLink() {
    ending_ = true;
    for (Line& line : lines_) line.heard = nullptr;
    for (const auto& process : processes_) process->send_signal(SIGINT);
    const Instant end = loop_.now() + seconds{5};
    const auto runs = [](const auto& process) { return process->running(); };
    while (std::any_of(processes_.begin(), processes_.end(), runs) && loop_.now() < end) {
      loop_.run_until(loop_.now() + milliseconds{20});
    }
  }
  LiveLink(const LiveLink&) = delete;
  LiveLink& operator=(const LiveLink&) = delete;

  void send(Way way, std::uint32_t number, std::size_t bytes) {
    bytes_.resize(bytes);
    std::memcpy(bytes_.data(), &number, sizeof number);
    line(way).out.publish("DATA", bytes_);
  }
  void on_heard(Way way, Heard heard) { line(way).heard = std::move(heard); }
  void run_for(
      Duration time, const std::function<bool()>& done = [] { return false; }) {
    const Instant end = loop_.now() + time;
    while (!done() && loop_.now() < end && failure_.empty()) {
      loop_.run_until(std::min(end, loop_.now() + milliseconds{20}));
      if (loop_.signal() != 0) failure_ = "interrupted";
    }
    if (!failure_.empty()) throw std::runtime_error(failure_);
  }
  RealTimeLoop& loop() { return loop_; }
  double cpu_s() const {
    double sum = 0.0;
    for (const auto& process : processes_) sum += bench::cpu_seconds(process->pid());
    return sum;
  }

 private:
  struct Line {
    UdpmBus out;
    UdpmBus in;
    Heard heard{};
  };

  static link::KeyPair keys(const std::string& side) {
    return link::key_pair_of(link::testing::key_number(side == "near" ? 1 : 2));
  }
  Line& line(Way way) { return lines_[static_cast<std::size_t>(way)]; }

  void start(const std::string& side, int lcm_port, int udp_port, std::size_t paths) {
    const bool is_near = side == "near";
    std::string text = fmt::format("key = \"{}.key\"\nlcm_url = \"{}\"\n", side, url_of(lcm_port));
    std::string addresses;
    for (std::size_t path = 0; path < paths; ++path) {
      const auto port = static_cast<std::size_t>(udp_port) + path;
      text += fmt::format("[[path]]\nname = \"{}\"\nbind = \"127.0.0.1:{}\"\n", path, port);
      addresses += fmt::format("\"127.0.0.1:{}\",", is_near ? port + 10 : port - 10);
    }
    text += fmt::format(
        "[[peer]]\nname = \"other\"\npublic_key = \"{}\"\naddresses = [{}]\n{} = [\"DATA\"]\n",
        link::key_text(keys(is_near ? "far" : "near").public_key), addresses,
        is_near ? "send" : "receive");
    const std::string file = folder_.file(side + ".toml", text).string();
    chmod(file.c_str(), 0644);
    processes_.push_back(std::make_unique<NodeProcess>(
        loop_,
        std::vector<std::string>{(executable_folder() / "tether-link").string(), "run", file},
        [this](const std::string& said) {
          said_ += said + "\n";
          if (said.find(": up, by") != std::string::npos) ++up_;
        },
        [this](int code) {
          if (!ending_) failure_ = fmt::format("tether-link ended: {}\n{}", code, said_);
        }));
    processes_.back()->start();
  }

  RealTimeLoop loop_;
  std::array<Line, 2> lines_{Line{{url_of(7670), loop_}, {url_of(7672), loop_}},
                             Line{{url_of(7667), loop_}, {url_of(7668), loop_}}};
  bench::BareForwarder first_{url_of(7670), url_of(7671)};
  bench::BareForwarder second_{url_of(7671), url_of(7672)};
  test::Folder folder_;
  std::vector<std::unique_ptr<NodeProcess>> processes_;
  std::vector<std::uint8_t> bytes_;
  std::string said_, failure_;
  int up_ = 0;
  bool ending_ = false;
};

/// Messages of 100 bytes at 1 kHz, in turn by each way: from publishing to handling.
void latency(benchmark::State& state) {
  for (auto unused : state) {
    (void)unused;
    std::array<Samples, 2> samples;
    std::vector<std::int64_t> sent;
    bool sending = true;
    LiveLink link(static_cast<std::size_t>(state.range(0)));
    for (const Way way : {Way::bare, Way::linked}) {
      link.on_heard(way, [&samples, &sent, way](std::uint32_t number, std::int64_t when_ns) {
        samples[static_cast<std::size_t>(way)].add(when_ns - sent.at(number));
      });
    }
    link.loop().every(link.loop().now(), milliseconds{1}, Priority::node, [&](Instant) {
      if (!sending) return;
      const auto number = static_cast<std::uint32_t>(sent.size());
      sent.push_back(now_ns());
      link.send(number % 2 == 0 ? Way::bare : Way::linked, number, 100);
    });
    link.run_for(bench::window(seconds{20}));
    sending = false;
    for (const Way way : {Way::bare, Way::linked}) link.on_heard(way, nullptr);
    Samples& bare = samples[0];
    Samples& linked = samples[1];
    if (bare.size() == 0 || linked.size() == 0) throw std::runtime_error("nothing was carried");
    state.SetIterationTime(linked.percentile_ms(0.5) * 1e-3);
    for (const auto& [name, share] : {std::pair{"p50", 0.5}, std::pair{"p99", 0.99}}) {
      state.counters[fmt::format("bare_{}_ms", name)] = bare.percentile_ms(share);
      state.counters[fmt::format("link_{}_ms", name)] = linked.percentile_ms(share);
      state.counters[fmt::format("added_{}_ms", name)] =
          linked.percentile_ms(share) - bare.percentile_ms(share);
    }
    state.counters["samples"] = static_cast<double>(linked.size());
  }
}

/// Messages per second by one way, with no more than a window under way.
double rate(LiveLink& link, Way way, std::size_t bytes, double& lost) {
  constexpr std::uint32_t kWindow = 64;
  std::uint32_t sent = 0, next = 0, heard = 0;
  bool going = true;
  const auto fill = [&] {
    while (going && sent - next < kWindow) link.send(way, sent++, bytes);
  };
  link.on_heard(way, [&](std::uint32_t number, std::int64_t) {
    if (number < next) return;
    lost += number - next;
    next = number + 1;
    ++heard;
    fill();
  });
  const std::int64_t start_ns = now_ns();
  const Instant end = link.loop().now() + seconds{1};
  for (std::uint32_t before = 0; link.loop().now() < end; before = next) {
    fill();
    link.run_for(std::min<Duration>(milliseconds{200}, end - link.loop().now()));
    if (next == before) {  // packets under way are lost
      lost += sent - next;
      next = sent;
    }
  }
  const double elapsed_s = static_cast<double>(now_ns() - start_ns) * 1e-9;
  going = false;
  link.run_for(milliseconds{300}, [&] { return next == sent; });
  link.on_heard(way, nullptr);
  return heard / elapsed_s;
}

void throughput(benchmark::State& state) {
  for (auto unused : state) {
    (void)unused;
    LiveLink link(static_cast<std::size_t>(state.range(0)));
    std::vector<double> bare, linked, ratio;
    double lost = 0.0, cpu_s = 0.0, messages = 0.0;
    for (int i = 0; i < bench::rounds(7); ++i) {
      bare.push_back(rate(link, Way::bare, 100, lost));
      const double before_s = link.cpu_s();
      linked.push_back(rate(link, Way::linked, 100, lost));
      cpu_s += link.cpu_s() - before_s;
      messages += linked.back();
      ratio.push_back(linked.back() / bare.back());
    }
    if (median(linked) <= 0.0) throw std::runtime_error("nothing was carried");
    state.SetIterationTime(1.0 / median(linked));
    state.counters["bare_per_s"] = median(bare);
    state.counters["link_per_s"] = median(linked);
    state.counters["over_bare"] = median(ratio);
    state.counters["cpu_us"] = 1e6 * cpu_s / messages;
    state.counters["lost"] = lost;
  }
}

BENCHMARK(seal_and_open)->ArgName("bytes")->Arg(100)->Arg(1300);
BENCHMARK(latency)->ArgName("paths")->Arg(1)->Arg(2)->Iterations(1)->UseManualTime()->Unit(
    benchmark::kMillisecond);
BENCHMARK(throughput)
    ->ArgName("paths")
    ->Arg(1)
    ->Arg(2)
    ->Iterations(1)
    ->UseManualTime()
    ->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace tether

int main(int argc, char** argv) { return tether::bench::run_benchmarks(argc, argv); }
