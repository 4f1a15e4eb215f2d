#include "doors/link/node/recording.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <string_view>

#include "common/base/errors.hpp"
#include "common/base/text.hpp"

namespace tether::link {
namespace {

constexpr double kNsPerS = 1e9;
constexpr std::int64_t kDay_ns = 86'400'000'000'000;

/// Names come from files and messages: only what no folder or shell takes for something else.
std::string as_file_name(std::string_view text) {
  std::string name;
  for (const char c : text.substr(0, 100)) {
    const bool plain = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9');
    name += plain || c == '_' ? c : '_';
  }
  return name;
}

double share(std::int64_t part, std::int64_t all) {
  return all > 0 ? static_cast<double>(part) / static_cast<double>(all) : 0.0;
}

}  // namespace

Recording::File& Recording::file_of(const path_fates_t& message) {
  const auto [place, is_new] = files_.try_emplace({message.peer, message.path});
  File& file = place->second;
  if (!is_new) return file;
  const auto path = std::filesystem::path(settings_.folder) /
                    (as_file_name(message.peer) + "-" + as_file_name(message.path) + ".csv");
  file.name = path.string();
  const bool taken = std::any_of(files_.begin(), files_.end(), [&](const auto& other) {
    return &other.second != &file && other.second.name == file.name;
  });
  if (taken) {
    throw UsageError(fmt::format("{}: two paths would be written here: give them other names",
                                 printable(file.name)));
  }
  if (std::filesystem::exists(path)) {
    throw UsageError(fmt::format(
        "{}: exists already, and is not overwritten: another --out, please", printable(file.name)));
  }
  file.out.open(path);
  file.out << fmt::format(
      "# Recorded by tether-link record: what became of the datagrams of \"{}\" by path \"{}\".\n"
      "time_s,lost,delay_ms\n",
      printable(message.peer), printable(message.path));
  return file;
}

void Recording::add_row(File& file, const path_fates_t& message, std::size_t row,
                        double offset_ms) {
  const bool lost = message.lost[row] != 0;
  const std::int64_t sent_ns = message.sent_ns[row];
  if (!file.sent_ns) file.sent_ns = sent_ns;
  const std::int64_t step_ns = sent_ns - *file.sent_ns;
  file.sent_ns = sent_ns;
  if (file.rows > 0) file.last_ns += step_ns < 1 || step_ns > kDay_ns ? 1 : step_ns;
  if (message.anew[row] != 0 && file.rows > 0) {
    ++file.gaps;
    file.gaps_s += static_cast<double>(std::max<std::int64_t>(step_ns, 0)) / kNsPerS;
    file.run = 0;
  }
  ++file.rows;
  file.out << fmt::format("{}.{:09d},{},", file.last_ns / 1'000'000'000,
                          file.last_ns % 1'000'000'000, lost ? 1 : 0);
  if (lost) {
    ++file.lost;
    ++file.run;
    file.out << '\n';
    return;
  }
  if (file.run > 0) {
    ++file.bursts;
    file.in_bursts += file.run;
    file.longest = std::max(file.longest, file.run);
    file.run = 0;
  }
  const double transit_ms = static_cast<double>(message.transit_ns[row]) / 1e6;
  const double delay_ms = std::max(0.0, transit_ms + offset_ms);
  file.delay_sum_ms += delay_ms;
  file.delay_most_ms = std::max(file.delay_most_ms, delay_ms);
  file.out << fmt::format("{:.6f}\n", delay_ms);
}

void Recording::take(const path_fates_t& message) {
  if (!settings_.peer.empty() && message.peer != settings_.peer) return;
  File& file = file_of(message);
  const bool known = message.offset_known != 0 || settings_.same_clock;
  if (!known) {
    file.without_delay += message.count;
    return;
  }
  double offset_ms = 0.0;
  if (settings_.same_clock) {
    file.clocks_differ =
        file.clocks_differ ||
        (message.offset_known != 0 && (message.offset_min_ms > 0.0 || message.offset_max_ms < 0.0));
  } else {
    offset_ms = 0.5 * (message.offset_min_ms + message.offset_max_ms);
    file.error_ms = std::max(file.error_ms, 0.5 * (message.offset_max_ms - message.offset_min_ms));
  }
  for (std::size_t row = 0; row < message.sent_ns.size(); ++row) {
    add_row(file, message, row, offset_ms);
  }
  file.out.flush();
  if (!file.out) {
    throw UsageError(fmt::format("{}: cannot be written: is there such a folder, and room?",
                                 printable(file.name)));
  }
}

std::string Recording::summary() const {
  std::string text;
  for (const auto& [key, f] : files_) {
    text += fmt::format(
        "{}: {} datagrams in {:.1f} s, {:.2f} % lost in {} bursts (mean {:.2f}, longest {}); mean "
        "delay {:.3f} ms, at most {:.3f} ms, {}\n",
        printable(f.name), f.rows, static_cast<double>(f.last_ns) / kNsPerS,
        100.0 * share(f.lost, f.rows), f.bursts, share(f.in_bursts, f.bursts), f.longest,
        f.rows > f.lost ? f.delay_sum_ms / static_cast<double>(f.rows - f.lost) : 0.0,
        f.delay_most_ms,
        settings_.same_clock ? "by one clock" : fmt::format("each ± {:.3f} ms", f.error_ms));
    if (f.gaps > 0) {
      text += fmt::format("  of {} {}, {:.1f} s in all, nothing is known\n", f.gaps,
                          f.gaps == 1 ? "stretch" : "stretches", f.gaps_s);
    }
    if (f.without_delay > 0) {
      text += fmt::format("  {} datagrams are left out: the clocks' offset was not known yet\n",
                          f.without_delay);
    }
    if (f.clocks_differ) text += "  the two clocks differ: do not record it with --same-clock\n";
  }
  return text;
}

}  // namespace tether::link
