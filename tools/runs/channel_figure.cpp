#include "tools/runs/channel_figure.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "tools/base/gnuplot.hpp"
#include "tools/base/replacing_output.hpp"

namespace tether {
namespace {

using Outcome = PacketFate::Outcome;

constexpr std::size_t kRow = 100;  // packets
constexpr int kSteps = 1000;       // steps of a distribution

bool received(const PacketFate& fate) { return fate.outcome == Outcome::under_way; }

const char* name_of(Outcome outcome) {
  switch (outcome) {
    case Outcome::under_way:
      return "received";
    case Outcome::outage:
      return "outage";
    case Outcome::lost:
      return "lost";
    case Outcome::overflowed:
      return "overflowed";
  }
  return "";
}

std::vector<double> sorted_delays_ms(const std::vector<PacketFate>& fates) {
  std::vector<double> delays;
  for (const PacketFate& fate : fates) {
    if (received(fate)) delays.push_back(to_milliseconds(fate.departure - fate.arrival));
  }
  std::sort(delays.begin(), delays.end());
  return delays;
}

// Okabe and Ito's colours, which all can tell apart.
constexpr char kLosses[] = R"gnuplot(
set datafile separator ","
set title title_text font ",11" noenhanced
set xlabel "packet of the row"
set ylabel "row's first packet"
set xrange [-1:100]
set yrange [rows - 0.4 : -0.6]
set ytics out nomirror ("0" 0)
do for [i = 1 : rows - 1] { set ytics add (sprintf("%d", 100 * i) i) }
set xtics out nomirror
set border 3
set key above horizontal samplen 1
set style fill solid noborder
box(what) = sprintf("'losses.csv' every ::1 using (strcol(3) eq '%s' ? int($1) %% 100 : NaN):(int($1) / 100):(0.5):(0.32) with boxxyerror lc rgb", what)
plot_losses = "plot " . box("received") . " '#a6d3f0' title 'received'"
if (lost) { plot_losses = plot_losses . ", " . box("lost") . " '#d55e00' title 'lost'" }
if (outage) { plot_losses = plot_losses . ", " . box("outage") . " '#cc79a7' title 'outage'" }
if (overflowed) { plot_losses = plot_losses . ", " . box("overflowed") . " '#e69f00' title 'no room'" }
if (states) {
  plot_losses = plot_losses . ", 'losses.csv' every ::1 using ($4 > 0 ? int($1) % 100 : NaN):(int($1) / 100 + 0.42):(0.5):(0.06) with boxxyerror lc rgb '#000000' title 'then in a bad state'"
}
height = 110 + 34 * rows

set terminal svg size 760,height font "Helvetica,12" background "white"
set output "losses.svg"
eval plot_losses
set terminal pngcairo size 950,1.25 * height font "Helvetica,12"
set output "losses.png"
eval plot_losses
set output
)gnuplot";

constexpr char kDelays[] = R"gnuplot(
set datafile separator ","
set title title_text font ",11" noenhanced
set xlabel "delay [ms]"
set ylabel "share of received packets"
set yrange [0:1.02]
set grid lc rgb "#dddddd"
set key bottom right
plot_delays = "plot 'delays.csv' every ::1 using 2:1 with lines lw 2 lc rgb '#0072b2' title 'achieved'"
if (configured) {
  plot_delays = "plot 'delays.csv' every ::1 using 2:3 with lines lw 7 lc rgb '#f0c27a' title 'configured', " \
    . "'' every ::1 using 2:1 with lines lw 2 lc rgb '#0072b2' title 'achieved'"
}

set terminal svg size 560,380 font "Helvetica,12" background "white"
set output "delays.svg"
eval plot_delays
set terminal pngcairo size 700,475 font "Helvetica,12"
set output "delays.png"
eval plot_delays
set output
)gnuplot";

}  // namespace

void draw_losses(const std::filesystem::path& folder, const ChannelFigure& figure) {
  const std::size_t count = std::min(kStripPackets, figure.fates.size());
  std::string csv = "packet,time_s,fate,state\n";
  for (std::size_t i = 0; i < count; ++i) {
    const PacketFate& fate = figure.fates[i];
    csv += fmt::format("{},{},{},{}\n", fate.number, to_seconds(fate.arrival - kStart),
                       name_of(fate.outcome), fate.state);
  }
  write_file(folder / "losses.csv", csv);
  const auto among = [&](const auto& holds) {
    return std::count_if(figure.fates.begin(),
                         figure.fates.begin() + static_cast<std::ptrdiff_t>(count), holds);
  };
  const auto any = [&](Outcome outcome) {
    return among([outcome](const PacketFate& fate) { return fate.outcome == outcome; }) > 0 ? 1 : 0;
  };
  const std::string script = fmt::format(
      "title_text = \"{}: {} of {} packets received, one every {:g} ms\"\nrows = {}\n"
      "lost = {}\noutage = {}\noverflowed = {}\nstates = {}\n",
      figure.title, among(received), count, figure.interval_s * 1e3, (count + kRow - 1) / kRow,
      any(Outcome::lost), any(Outcome::outage), any(Outcome::overflowed),
      among([](const PacketFate& fate) { return fate.state > 0; }) > 0 ? 1 : 0);
  run_gnuplot(folder, "losses.gp", script + kLosses);
}

void draw_delays(const std::filesystem::path& folder, const ChannelFigure& figure) {
  const std::vector<double> delays = sorted_delays_ms(figure.fates);
  if (delays.empty()) return;
  const LinkExpectation& expected = figure.expected;
  const bool configured = expected.channel && expected.no_delays.empty();
  std::string csv = "achieved,delay_ms,configured\n";
  for (int i = 0; i <= kSteps; ++i) {
    const auto rank = static_cast<std::size_t>(
        std::lround(static_cast<double>(i) / kSteps * static_cast<double>(delays.size() - 1)));
    const double delay_ms = delays[rank];
    const double share = static_cast<double>(rank + 1) / static_cast<double>(delays.size());
    csv += fmt::format("{:.6f},{:.6f},", share, delay_ms);
    csv +=
        configured ? fmt::format("{:.6f}\n", expected.channel->delay_cdf(delay_ms * 1e-3)) : "\n";
  }
  write_file(folder / "delays.csv", csv);
  // The last thousandth may be very far out: it is in the data, not in the drawing.
  const double last = delays[delays.size() - 1 - delays.size() / 1000];
  const double margin = std::max(0.03 * (last - delays.front()), 0.01);
  const double low = std::max(0.0, delays.front() - margin), high = last + margin;
  const std::string script = fmt::format(
      "title_text = \"{}: {} packets received\"\nconfigured = {}\n"
      "set xrange [{}:{}]\n",
      figure.delay_title, delays.size(), configured ? 1 : 0, low, high);
  run_gnuplot(folder, "delays.gp", script + kDelays);
}

}  // namespace tether
