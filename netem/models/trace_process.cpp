#include "netem/models/trace_process.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "common/base/errors.hpp"
#include "netem/models/kinds.hpp"

namespace tether {
namespace {

Duration start_in_trace(const Trace& trace, const TraceConfig& config,
                        const std::string& key_prefix) {
  if (!config.start_s) return Duration{0};
  const double since_first_s = *config.start_s - trace.first_s;
  if (!(std::abs(since_first_s) <= 4e9)) {
    throw UsageError(fmt::format("{}start_s = {} must be within 4e9 s of the trace's first row, {}",
                                 key_prefix, *config.start_s, trace.first_s));
  }
  return from_seconds(since_first_s);
}

std::vector<ScenarioKey> keys(const LinkField& field) {
  using Interpolation = TraceConfig::Interpolation;
  using AtEnd = TraceConfig::AtEnd;
  auto t = field.keys_of<TraceConfig>("trace");
  t.file("file", &TraceConfig::file, "CSV of recorded conditions: time_s, delay_ms, prr or lost");
  t.choice<Interpolation>("interpolation", &TraceConfig::interpolation,
                          {{"step", Interpolation::step}, {"linear", Interpolation::linear}},
                          "between rows");
  t.choice<AtEnd>("at_end", &TraceConfig::at_end, {{"hold", AtEnd::hold}, {"loop", AtEnd::loop}},
                  "after the last row");
  t.optional_number("start_s", &TraceConfig::start_s, {-4e9, 4e9, false},
                    "the trace's time at the run's start; its first row's if not given");
  return t.take();
}

ProcessPtr make(const ProcessNeeds& needs) {
  if (needs.shared) return needs.shared;
  if (needs.same<TraceConfig>()) return needs.present;
  return make_trace_process(needs.link.own.get<TraceConfig>(), needs.prefix + "trace.");
}

void export_loss(const LinkConfig&, const TcSender&, TcDraft& out) {
  out.notes.emplace_back("model = \"trace\" has no equivalent: netem plays no recordings");
  out.command += tc_random_loss(out.loss);
}

}  // namespace

TraceProcess::TraceProcess(std::shared_ptr<const Trace> trace, const TraceConfig& config,
                           const std::string& key_prefix)
    : trace_(std::move(trace)),
      interpolation_(config.interpolation),
      loop_(config.at_end == TraceConfig::AtEnd::loop),
      start_(start_in_trace(*trace_, config, key_prefix)) {
  if (loop_ && trace_->rows.size() < 2) {
    throw UsageError(
        fmt::format("{}at_end = \"loop\" needs a trace of two rows or more", key_prefix));
  }
  if (loop_) {
    const Duration last = trace_->rows.back().since_first;
    round_ = last + (last - trace_->rows[trace_->rows.size() - 2].since_first);
  }
  advance(kStart);
  now_ = Instant::min();  // runs may begin before t = 0
}

void TraceProcess::find_row(Duration since_first) {
  const auto& rows = trace_->rows;
  const auto begins_by = [&](std::size_t row) { return rows[row].since_first <= since_first; };
  const auto holds = [&](std::size_t row) {
    return begins_by(row) && (row + 1 == rows.size() || !begins_by(row + 1));
  };
  if (holds(row_)) return;
  if (row_ + 1 < rows.size() && holds(row_ + 1)) {
    ++row_;
    return;
  }
  const auto later =
      std::upper_bound(rows.begin(), rows.end(), since_first,
                       [](Duration time, const Trace::Row& row) { return time < row.since_first; });
  row_ = later == rows.begin() ? 0 : static_cast<std::size_t>(later - rows.begin()) - 1;
}

void TraceProcess::advance(Instant now) {
  if (now < now_) return;
  now_ = now;
  const auto& rows = trace_->rows;
  Duration phase = now.time_since_epoch() + start_;
  if (loop_) {
    phase %= round_;
    if (phase < Duration{0}) phase += round_;
  }
  find_row(phase);
  const Trace::Row& row = rows[row_];
  condition_ = {row.prr, row.delay};
  const bool is_last = row_ + 1 == rows.size();
  const bool is_before_first = phase < row.since_first;
  const bool stays = is_before_first || (is_last && !loop_);
  const Duration end = is_last ? round_ : rows[row_ + 1].since_first;
  until_ = Instant::max();
  if (interpolation_ == TraceConfig::Interpolation::step) {
    if (is_before_first) until_ = now + (row.since_first - phase);
    if (!stays) until_ = now + (end - phase);
    return;
  }
  if (stays) return;
  const Trace::Row& next = rows[is_last ? 0 : row_ + 1];
  const double share = to_seconds(phase - row.since_first) / to_seconds(end - row.since_first);
  if (!trace_->of_fates) condition_.prr += share * (next.prr - row.prr);
  condition_.delay += from_seconds(share * to_seconds(next.delay - row.delay));
}

std::shared_ptr<ChannelProcess> make_trace_process(const TraceConfig& config,
                                                   const std::string& key_prefix) {
  if (config.file.empty()) {
    throw UsageError(
        fmt::format("{}file is needed: a CSV file of recorded conditions", key_prefix));
  }
  return std::make_shared<TraceProcess>(kept_trace(config.file), config, key_prefix);
}

ChannelModelKind trace_model() {
  ChannelModelKind kind{.name = "trace", .keys = keys};
  kind.not_shared = same_settings<TraceConfig>;
  kind.moves = [](const LinkConfig&) { return ChannelModelKind::Moves::in_time; };
  kind.make = make;
  kind.why_open = "the recording decides";
  kind.export_loss = export_loss;
  return kind;
}

}  // namespace tether
