#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "netem/fit/link_expectation.hpp"
#include "netem/link/link.hpp"

namespace tether {

/// Drawn curves of a link.
struct ChannelFigure {
  std::string title;        ///< title of the losses: "downlink, gilbert_elliott"
  std::string delay_title;  ///< "downlink, gamma delays"
  double interval_s = 1.0;
  std::vector<PacketFate> fates;  ///< from sample_fates()
  LinkExpectation expected;
};

/// Draws into `folder`, each figure as .svg and .png, with its data (.csv) and script (.gp) beside
/// it:
///   losses: the fates of the first kStripPackets, one box a packet, and the channel's state
///   delays: distribution of all received packets' delays, as configured (where the model says) and
///           as achieved; not drawn if nothing was received
/// Throws if a file cannot be written, or gnuplot is missing or fails.
inline constexpr std::size_t kStripPackets = 500;
void draw_losses(const std::filesystem::path& folder, const ChannelFigure& figure);
void draw_delays(const std::filesystem::path& folder, const ChannelFigure& figure);

}  // namespace tether
