#include "tools/view/sources/paced_run.hpp"

#include <poll.h>

#include <algorithm>
#include <chrono>

#include "common/base/errors.hpp"
#include "tools/view/sources/playback_request.hpp"

namespace tether {
namespace {

constexpr Duration kStep = std::chrono::milliseconds{10};
/// If computing is this much late, the run goes on more slowly and does not catch up.
constexpr Duration kMostLate = std::chrono::milliseconds{200};
constexpr Duration kPacedTellPeriod = std::chrono::milliseconds{100};

/// A clock that never steps back.
Instant wall() {
  const auto now = std::chrono::steady_clock::now().time_since_epoch();
  return Instant{std::chrono::duration_cast<Duration>(now)};
}

}  // namespace

PacedRun::PacedRun(Instant start, Instant end, double speed, ViewServer& server,
                   NetworkView& network)
    : start_(start),
      end_(end),
      server_(server),
      network_(network),
      playback_(start, end),
      computed_(start) {
  playback_.set_speed(wall(), speed);
  tell();
}

void PacedRun::run(const RunUntil& run_until) {
  playback_.play(wall());
  while (computed_ < end_) {
    const Instant wanted = playback_.position(wall());
    const auto step = [this](Duration d) {
      return from_seconds(to_seconds(d) * playback_.speed());
    };
    computed_ = std::min(wanted, computed_ + step(kStep));
    run_until(computed_);
    if (wanted - computed_ > step(kMostLate)) playback_.seek(wall(), computed_);
    if (wall() - told_ >= kPacedTellPeriod) tell();
    wait();
    take_requests();
  }
  tell();
}

/// Until there is something to compute or a request.
void PacedRun::wait() {
  const bool late = playback_.position(wall()) - computed_ >= kStep;
  pollfd requests{server_.requests_fd(), POLLIN, 0};
  poll(&requests, 1, late ? 0 : static_cast<int>(kStep / std::chrono::milliseconds{1}));
}

void PacedRun::take_requests() {
  for (const ViewRequest& request : server_.take_requests()) {
    if (!network_.take(request)) take(request);
  }
}

void PacedRun::take(const ViewRequest& request) {
  ViewAnswer answer{request.client, request.request, {}, ""};
  try {
    for (const Parameter& parameter : parameters_of(request)) {
      answer.parameters.push_back(parameter.name);
    }
    for (const Parameter& parameter : parameters_of(request)) set(parameter);
  } catch (const UsageError& error) {
    answer.error = error.what();
  }
  tell();
  server_.answer(std::move(answer));
}

void PacedRun::set(const Parameter& parameter) {
  if (parameter.name == "playback.playing") {
    if (switch_of(parameter)) {
      playback_.play(wall());
    } else {
      playback_.pause(wall());
    }
  } else if (parameter.name == "playback.speed") {
    playback_.set_speed(wall(), number_of(parameter, Playback::kSlowest, Playback::kFastest));
  } else {
    refuse_parameter(parameter, "cannot be set: the run is being computed");
  }
}

void PacedRun::tell() {
  told_ = wall();
  const auto shown = std::max(Duration::zero(), computed_.time_since_epoch());
  server_.tell_time(static_cast<std::uint64_t>(shown.count()));
  server_.update({{"playback.position_s", to_seconds(computed_)},
                  {"playback.playing", playback_.playing(wall())},
                  {"playback.speed", playback_.speed()},
                  {"playback.start_s", to_seconds(start_)},
                  {"playback.end_s", to_seconds(end_)}});
}

}  // namespace tether
