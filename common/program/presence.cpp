#include "common/program/presence.hpp"

#include <unistd.h>

#include <array>
#include <utility>

#include "common/bus/message_io.hpp"

namespace tether {

std::string host_name() {
  std::array<char, 256> name{};
  return gethostname(name.data(), name.size() - 1) == 0 ? name.data() : "unknown";
}

Presence::Presence(EventLoop& loop, std::vector<Bus*> buses, const std::string& program,
                   const std::string& vehicle)
    : loop_(loop), buses_(std::move(buses)) {
  message_.program = program;
  message_.vehicle = vehicle;
  message_.host = host_name();
  message_.pid = getpid();
  const Duration period = from_seconds(to_seconds(kPresencePeriod) * loop.rate());
  loop.every(loop.now(), period, Priority::observer, [this](Instant) { publish_now(); });
}

void Presence::answer() {
  const Duration gap = from_seconds(to_seconds(kLeastGap) * loop_.rate());
  if (!published_ || loop_.now() - *published_ >= gap) publish_now();
}

void Presence::publish_now() {
  published_ = loop_.now();
  message_.utime = to_utime(*published_);
  message_.run = loop_.run_id();
  for (Bus* bus : buses_) publish(*bus, kPresenceChannel, message_);
  ++message_.seq;
}

}  // namespace tether
