#include "tools/margin/stability_map.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "common/base/errors.hpp"
#include "controller/laws/controller_settings.hpp"
#include "netem/channel/settings.hpp"
#include "tools/base/gnuplot.hpp"
#include "tools/base/replacing_output.hpp"
#include "tools/margin/design_search.hpp"
#include "tools/margin/loop_margins.hpp"

namespace tether {
namespace {

Critical critical_prr(const StraightLoop& loop, double delay_s) {
  const LoopStep step = loop.step({loop.timing.period_s, delay_s, 0.0});
  const LoopStep across = part_of(step, LoopPart::across), along = part_of(step, LoopPart::along);
  return critical_value(
      [&](double prr) {
        const LossChain chain =
            both_links(ChainLink::independent(prr), ChainLink::independent(prr));
        return std::max(mean_square_radius(chain, {across}), mean_square_radius(chain, {along}));
      },
      0.02, 1.0, 1e-3);
}

constexpr char kScript[] = R"gnuplot(
set datafile separator ","
set title title_text font ",11" noenhanced
set xlabel "packets received each way [%], lost independently"
set ylabel "delay from pose to wheels [ms]"
set xrange [0:102]
set yrange [-0.04 * longest_ms : 1.04 * longest_ms]
set grid lc rgb "#dddddd"
set key at screen 0.5, 0.015 center bottom horizontal samplen 2
set bmargin 8
set terminal @terminal
set output picture
plot edges every ::1 using (100 * $2):(1000 * $1) with filledcurves closed fc rgb "#cfe8d8" title "mean-square stable, computed", \
  edges every ::1 using (100 * $2):($2 < 1 ? 1000 * $1 : NaN) with lines lw 2.5 lc rgb "#1b9e4b" notitle, \
  points every ::1 using (100 * $1):($3 <= limit ? 1000 * $2 : NaN) with points pt 7 ps 1.1 lc rgb "#0072b2" \
    title sprintf("simulated: off by %g m at most", limit), \
  points every ::1 using (100 * $1):($3 > limit ? 1000 * $2 : NaN) with points pt 2 ps 1.1 lw 2 lc rgb "#d55e00" \
    title "simulated: more"
set output
)gnuplot";

}  // namespace

void check_map(const Scenario& scenario) {
  refuse_margin_obstacles(scenario);
  if (has_linear_plans(scenario.get<ControllerSettings>())) {
    throw UsageError(
        "tether margin --figure: controller.law must be \"tracking\" or \"pid\": the map varies "
        "delays, which plans may not have here");
  }
  const auto& channel = scenario.get<ChannelSettings>();
  if (channel.uplink.model == "fixed" && channel.downlink.model == "fixed") return;
  throw UsageError(
      "tether margin --figure: channel.uplink.model and channel.downlink.model must be \"fixed\": "
      "the map's losses are independent");
}

StabilityMap stability_map(const Scenario& scenario, double limit_m, std::size_t seeds,
                           std::size_t jobs) {
  check_map(scenario);
  const auto& channel = scenario.get<ChannelSettings>();
  const StraightLoop loop(scenario);
  const double least_s = loop.timing.total_s() - 1e-3 * channel.uplink.fixed.delay_ms;
  StabilityMap map;
  map.limit_m = limit_m;
  map.seeds = seeds;
  const LossChain lossless = both_links(ChainLink::independent(1.0), ChainLink::independent(1.0));
  const Critical longest = critical_delay(loop, lossless);
  const double most_s = longest_delay_s(loop.timing.period_s);
  const double end_s = longest.kind == Critical::Kind::found ? longest.value : most_s;
  constexpr int kEdges = 48, kColumns = 9, kRows = 7;
  for (int i = 0; i <= kEdges; ++i) {
    const double delay_s = end_s * i / kEdges;
    const Critical prr = critical_prr(loop, delay_s);
    if (prr.kind == Critical::Kind::found) map.edges.push_back({delay_s, prr.value});
    if (prr.kind == Critical::Kind::always) map.edges.push_back({delay_s, 0.0});
  }
  map.longest_s = std::min(most_s, 1.2 * end_s);
  for (int row = 0; row < kRows; ++row) {
    const double delay_s = map.longest_s * row / (kRows - 1);
    if (delay_s < least_s) continue;
    for (int column = 1; column <= kColumns + 1; ++column) {
      const double prr = 0.1 * column;
      Scenario one = scenario;
      auto& links = one.get<ChannelSettings>();
      links.uplink.fixed = {prr, 1e3 * (delay_s - least_s)};
      links.downlink.fixed.prr = prr;
      map.points.push_back({prr, delay_s, settled_error(one, seeds, jobs).mean_m});
    }
  }
  return map;
}

void check_map_file(const std::filesystem::path& file) {
  const std::string kind = file.extension().string();
  if (kind == ".png" || kind == ".svg") return;
  throw UsageError(fmt::format("--figure {}: must end in .png or .svg", file.string()));
}

void draw_stability_map(const std::filesystem::path& file, const Scenario& scenario,
                        const StabilityMap& map) {
  check_map_file(file);
  const std::string kind = file.extension().string();
  const std::filesystem::path folder = file.has_parent_path() ? file.parent_path() : ".";
  std::filesystem::create_directories(folder);
  const std::string stem = file.stem().string();
  std::string edges = "delay_s,prr\n", points = "prr,delay_s,error_m\n";
  for (const auto& e : map.edges) edges += fmt::format("{},{}\n", e.delay_s, e.prr);
  if (!map.edges.empty()) {  // around the stable side, back to its beginning
    edges += fmt::format("{},1\n{},1\n", map.edges.back().delay_s, map.edges.front().delay_s);
  }
  for (const auto& p : map.points) points += fmt::format("{},{},{}\n", p.prr, p.delay_s, p.error_m);
  write_file((folder / (stem + "-edge.csv")).string(), edges);
  write_file((folder / (stem + "-runs.csv")).string(), points);
  const StraightLoop loop(scenario);
  const std::string terminal = kind == ".png"
                                   ? "pngcairo size 900,640 font \"Helvetica,12\""
                                   : "svg size 720,512 font \"Helvetica,12\" background \"white\"";
  run_gnuplot(folder, stem + ".gp",
              fmt::format("title_text = \"{}, a pose every {:g} ms, {:.2f} m/s; {} runs a point\"\n"
                          "edges = '{}-edge.csv'\npoints = '{}-runs.csv'\nlimit = {}\n"
                          "longest_ms = {}\nterminal = '{}'\npicture = '{}'\n",
                          scenario.get<ControllerSettings>().law, 1e3 * loop.timing.period_s,
                          loop.v_mps, map.seeds, stem, stem, map.limit_m, 1e3 * map.longest_s,
                          terminal, file.filename().string()) +
                  kScript);
}

}  // namespace tether
