#include "common/program/loop_report.hpp"

#include <tether/counters_t.hpp>
#include <utility>

#include "common/node/message_io.hpp"
#include "common/program/presence.hpp"

namespace tether {
namespace {

/// A loop that has no task of its own so often would not notice that it is late.
constexpr Duration kLook = std::chrono::milliseconds{20};

}  // namespace

LoopReport::LoopReport(RealTimeLoop& loop, std::vector<Bus*> buses, std::string program)
    : loop_(loop), buses_(std::move(buses)), program_(std::move(program)) {
  const auto of_wall = [&loop](Duration d) { return from_seconds(to_seconds(d) * loop.rate()); };
  loop.every(kStart, of_wall(kLook), Priority::observer, [](Instant) {});
  loop.every(kStart, of_wall(kPresencePeriod), Priority::observer,
             [this](Instant) { publish_now(); });
}

void LoopReport::publish_now() {
  counters_t message{};
  message.utime = to_utime(loop_.now());
  message.seq = seq_++;
  message.node = program_;
  message.name = {"loop.slips", kLatenessCounter};
  message.value = {static_cast<std::int64_t>(loop_.slips()),
                   static_cast<std::int64_t>(1e6 * loop_.lateness_s2())};
  message.count = static_cast<std::int32_t>(message.name.size());
  for (Bus* bus : buses_) publish(*bus, kLoopChannel, message);
}

}  // namespace tether
