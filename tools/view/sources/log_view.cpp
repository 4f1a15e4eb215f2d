#include "tools/view/sources/log_view.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include "common/base/errors.hpp"
#include "common/base/input_file.hpp"
#include "common/base/text.hpp"
#include "tools/log/log_input.hpp"
#include "tools/view/sources/playback_request.hpp"

namespace tether {
namespace {

/// Interval between reported positions.
constexpr Duration kTellPeriod = std::chrono::milliseconds{100};
/// Later ones are of the wall clock.
constexpr Instant kYear2000{std::chrono::seconds{946'684'800}};

std::uint64_t to_ns(Instant time) {
  return static_cast<std::uint64_t>(std::max(Duration::zero(), time.time_since_epoch()).count());
}

}  // namespace

ViewedLog::ViewedLog(const std::string& file)
    : file_(file), stream_(open_input(file, "the log", kMostRecordingBytes)) {
  LogInput log(file);
  index_.emplace(log.reader, file);
  constexpr std::size_t kShown = 20;
  const auto& damage = log.reader.damage();
  for (std::size_t i = 0; i < std::min(kShown, damage.size()); ++i) {
    notes_.push_back(describe(damage[i]));
  }
  if (damage.size() > kShown) {
    notes_.push_back(fmt::format("and {} further places", damage.size() - kShown));
  }
  if (index_->entries().empty()) {
    throw UsageError(
        fmt::format("{} holds no message{}", file, notes_.empty() ? "" : ": " + notes_.front()));
  }
  if (index_->entries().front().time > kYear2000) zero_ = index_->entries().front().time;
  constexpr double kLongest_s = 4e9;  // largest argument of from_seconds()
  if (start_s() < -kLongest_s || end_s() > kLongest_s) {
    throw UsageError(fmt::format("{}: its time stamps are more than 127 years apart", file));
  }
  find_scenario();
}

void ViewedLog::find_scenario() {
  const auto beside = std::filesystem::path(file_).parent_path() / "scenario.toml";
  std::error_code error;
  if (!std::filesystem::is_regular_file(beside, error)) return;
  try {
    scenario_ = load_scenario(beside.string(), {});
  } catch (const UsageError& unusable) {
    notes_.push_back(fmt::format("the scenario beside the log cannot be used: {}",
                                 printable_message(unusable.what())));
  }
}

std::span<const std::uint8_t> ViewedLog::read(const LogIndex::Entry& entry) {
  bytes_.resize(entry.size_bytes);
  stream_.clear();
  stream_.seekg(static_cast<std::streamoff>(entry.offset_bytes));
  stream_.read(reinterpret_cast<char*>(bytes_.data()), entry.size_bytes);
  if (!stream_) bytes_.clear();
  return bytes_;
}

LogView::LogView(Instant now, ViewedLog& log, ViewServer& server)
    : log_(log), server_(server), player_(log.index()) {
  player_.play(now);
  tell(now);
}

void LogView::advance(Instant now) {
  for (const std::size_t i : player_.due(now)) {
    const LogIndex::Entry& entry = log_.index().entries()[i];
    server_.hear(log_.index().channel(entry), log_.read(entry), to_ns(entry.time));
  }
  if (now - told_ >= kTellPeriod) tell(now);
}

void LogView::tell(Instant now) {
  told_ = now;
  const Playback& playback = player_.playback();
  const Instant position = playback.position(now);
  server_.tell_time(to_ns(position));
  server_.update({{"playback.position_s", to_seconds(position - log_.zero())},
                  {"playback.playing", playback.playing(now)},
                  {"playback.speed", playback.speed()},
                  {"playback.start_s", log_.start_s()},
                  {"playback.end_s", log_.end_s()}});
}

void LogView::take(Instant now, const ViewRequest& request) {
  ViewAnswer answer{request.client, request.request, {}, ""};
  try {
    for (const Parameter& parameter : parameters_of(request)) {
      answer.parameters.push_back(parameter.name);
    }
    for (const Parameter& parameter : parameters_of(request)) set(now, parameter);
  } catch (const UsageError& error) {
    answer.error = error.what();
  }
  advance(now);
  tell(now);
  server_.answer(std::move(answer));
}

void LogView::set(Instant now, const Parameter& parameter) {
  if (parameter.name == "playback.playing") {
    if (switch_of(parameter)) {
      player_.play(now);
    } else {
      player_.pause(now);
    }
  } else if (parameter.name == "playback.speed") {
    player_.set_speed(now, number_of(parameter, Playback::kSlowest, Playback::kFastest));
  } else if (parameter.name == "playback.position_s") {
    const double position_s = number_of(parameter, log_.start_s(), log_.end_s());
    player_.seek(now, log_.zero() + from_seconds(position_s));
  } else {
    refuse_parameter(parameter, "cannot be set");
  }
}

}  // namespace tether
