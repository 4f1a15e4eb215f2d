#include <benchmark/benchmark.h>

#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "netem/channel/settings.hpp"
#include "netem/fit/channel_watch.hpp"
#include "netem/relay/make_links.hpp"
#include "netem/stages/delay_law.hpp"
#include "tools/runs/channel_report.hpp"

// Cost of a packet in a link: offered, carried, delivered, in virtual time. Each model and each
// stage alone, then all together; a packet of 80 bytes every millisecond.

namespace tether {
namespace {

constexpr std::size_t kBytes = 80;

void one_packet(benchmark::State& state, const std::vector<std::string>& keys) {
  LinkPair links = make_links(parse_scenario("", "bench", keys));
  Link& link = links.uplink;
  const std::function<void(const Packet&)> drop = [](const Packet&) {};
  Instant now = kStart;
  std::vector<std::uint8_t> bytes(kBytes);
  for (auto _ : state) {
    now += std::chrono::milliseconds{1};
    benchmark::DoNotOptimize(link.push(now, {"CTRL/POSE", bytes}));
    link.pop_ready(now, drop);
  }
  state.SetItemsProcessed(state.iterations());
  state.counters["in_flight"] = static_cast<double>(link.in_flight());
}

/// Cost of the above without a link: making and freeing a packet.
void caller_alone(benchmark::State& state) {
  const std::vector<std::uint8_t> bytes(kBytes);
  for (auto _ : state) {
    Packet packet{"CTRL/POSE", bytes};
    benchmark::DoNotOptimize(packet.bytes.data());
  }
}
BENCHMARK(caller_alone);

/// Cost of a vehicle's position for a link of model map, for a vehicle that moves and for one that
/// stands. This is once a pose, not once a packet.
void position(benchmark::State& state, double step_m) {
  LinkPair links =
      make_links(parse_scenario("", "bench",
                                {"channel.model=map", "channel.map.access_points=[[0, 0], [50, 0]]",
                                 "channel.map.shadowing_sd_db=6"}));
  double x_m = 0.0;
  for (auto _ : state) {
    x_m += step_m;
    links.uplink.process().on_position(x_m, 3.0, kStart);
  }
  state.SetItemsProcessed(state.iterations());
}
BENCHMARK_CAPTURE(position, map_moving, 0.01);
BENCHMARK_CAPTURE(position, map_standing, 0.0);

/// Cost of watching a link: fates as the link told them, told to a monitor.
void monitor(benchmark::State& state, const std::vector<std::string>& keys) {
  const Scenario scenario = parse_scenario("", "bench", keys);
  LinkPair links = make_links(scenario);
  std::vector<PacketFate> fates;
  links.uplink.set_observer([&fates](const PacketFate& fate) { fates.push_back(fate); });
  for (int n = 0; n < 100'000; ++n) {
    const Instant now = kStart + n * std::chrono::milliseconds{50};
    links.uplink.push(now, {"", std::vector<std::uint8_t>(kBytes)});
    links.uplink.pop_ready(now, [](const Packet&) {});
  }
  const LinkConfig& link = scenario.get<ChannelSettings>().uplink;
  LinkMonitor monitor(expect_link(link, pose_traffic(scenario)));
  std::size_t next = 0;
  for (auto _ : state) {
    monitor.on_packet(fates[next]);
    if (++next == fates.size()) next = 0;
  }
  state.SetItemsProcessed(state.iterations());
}

/// With so many packets under way; with constant and with random delays.
void crowded(benchmark::State& state, const char* law) {
  const auto packets = static_cast<double>(state.range(0));
  std::vector<std::string> keys{"channel.uplink.delay_ms=" + std::to_string(packets)};
  if (std::string(law) != "none") {
    keys.push_back("channel.uplink.jitter.sd_ms=" + std::to_string(0.2 * packets));
    keys.push_back(std::string("channel.uplink.jitter.law=") + law);
  }
  keys.emplace_back("channel.uplink.queue_limit=1000000");
  LinkPair links = make_links(parse_scenario("", "bench", keys));
  Link& link = links.uplink;
  const std::function<void(const Packet&)> drop = [](const Packet&) {};
  Instant now = kStart;
  const std::vector<std::uint8_t> bytes(kBytes);
  const auto step = [&] {
    now += std::chrono::milliseconds{1};
    link.push(now, {"CTRL/POSE", bytes});
    link.pop_ready(now, drop);
  };
  for (double i = 0.0; i < 2.0 * packets; i += 1.0) step();
  for (auto _ : state) step();
  state.SetItemsProcessed(state.iterations());
  state.counters["in_flight"] = static_cast<double>(link.in_flight());
}

std::string up(const std::string& key) { return "channel.uplink." + key; }

std::vector<std::string> jitter(const std::string& law) {
  return {up("jitter.law=" + law), up("jitter.mean_ms=10"), up("jitter.sd_ms=4"),
          up("jitter.correlation=0.5")};
}

/// A recording of 1000 s, a row every second, played again and again.
std::string trace_file() {
  const auto file = std::filesystem::temp_directory_path() / "tether-channel-bench.csv";
  std::ofstream out(file);
  out << "time_s,delay_ms,prr\n";
  for (int i = 0; i <= 1000; ++i) out << i << ',' << i % 7 << ',' << 0.1 * (i % 11) << '\n';
  return file.string();
}

struct Case {
  std::string name;
  std::vector<std::string> keys;
};

std::vector<Case> cases() {
  std::vector<Case> list{
      {"fixed", {}},
      {"markov", {up("model=markov")}},
      {"gilbert_elliott",
       {up("model=gilbert_elliott"), up("gilbert_elliott.p=0.02"), up("gilbert_elliott.r=0.1")}},
      {"four_state", {up("model=four_state"), up("four_state.p13=0.05")}},
      {"chain_in_time",
       {up("model=chain"), up("chain.prr=[1, 0.5, 0]"),
        up("chain.rates_per_s=[[0, 1, 1], [1, 0, 1], [1, 1, 0]]")}},
      {"chain_per_packet",
       {up("model=chain"), up("chain.prr=[1, 0.5, 0]"),
        up("chain.probabilities=[[0.9, 0.1, 0], [0, 0.9, 0.1], [0.1, 0, 0.9]]")}},
      {"trace", {up("model=trace"), up("trace.file=" + trace_file()), up("trace.at_end=loop")}},
      {"map",
       {up("model=map"), up("map.access_points=[[0, 0], [50, 0]]"), up("map.shadowing_sd_db=6")}},
      {"loss", {up("loss=0.1")}},
      {"corrupt", {up("corrupt.probability=0.1")}},
      {"duplicate", {up("duplicate.probability=0.1")}},
      {"rate", {up("rate.bits_per_s=1e6")}},
      {"reorder", {up("reorder.probability=0.1"), up("delay_ms=10")}},
      {"in_order", {up("in_order=true"), up("delay_ms=10")}},
      {"slot", {up("slot.period_ms=10")}},
      {"slot_with_limit", {up("slot.period_ms=10"), up("slot.packets=12")}},
      {"outages", {up("outages=[[1, 2], [3, 4]]")}}};
  for (const char* law : {"uniform", "normal", "pareto", "paretonormal", "gamma", "lognormal"}) {
    list.push_back({std::string("jitter_") + law, jitter(law)});
  }
  list.push_back({"jitter_table", {up("jitter.law=table"), up("jitter.table_ms=[0, 1, 2, 9]")}});
  Case all{"everything", jitter("gamma")};
  for (const char* key :
       {"model=gilbert_elliott", "gilbert_elliott.p=0.02", "gilbert_elliott.r=0.1", "loss=0.01",
        "corrupt.probability=0.1", "duplicate.probability=0.1", "rate.bits_per_s=1e6",
        "reorder.probability=0.1", "slot.period_ms=10", "outages=[[1, 2]]"}) {
    all.keys.push_back(up(key));
  }
  list.push_back(all);
  return list;
}

const bool kRegistered = [] {
  for (const Case& c : cases()) {
    benchmark::RegisterBenchmark(("packet/" + c.name).c_str(), one_packet, c.keys);
  }
  for (const Case& c : cases()) {
    if (c.name != "fixed" && c.name != "gilbert_elliott" && c.name != "jitter_gamma") continue;
    benchmark::RegisterBenchmark(("monitor/" + c.name).c_str(), monitor, c.keys);
  }
  for (const char* law : {"none", "uniform"}) {
    benchmark::RegisterBenchmark((std::string("crowded/jitter_") + law).c_str(), crowded, law)
        ->Arg(1000)
        ->Arg(100'000);
  }
  return true;
}();

}  // namespace
}  // namespace tether
