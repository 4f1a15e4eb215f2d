#include "bench/network/live_relay.hpp"

#include <fmt/format.h>

#include <chrono>
#include <csignal>
#include <cstring>
#include <ctime>
#include <stdexcept>
#include <utility>

#include "common/base/share.hpp"
#include "common/lcm/lcm_url.hpp"
#include "tools/base/process.hpp"

namespace tether::bench {

LiveRelay::LiveRelay(const std::vector<std::string>& overrides)
    : loop_(RealTimeLoop::wall_utime_us()),
      lines_{Line{{kPlain, loop_}, {kPlain, loop_}}, Line{{kBareNear, loop_}, {kBareFar, loop_}},
             Line{{kNear, loop_}, {kFar, loop_}}},
      near_(kNear, loop_),
      forwarder_(checked_lcm_url(kBareNear), checked_lcm_url(kBareFar)) {
  for (Line& line : lines_) listen(line.in, line.heard);
  std::vector<std::string> command{(executable_folder() / "tether-netem").string(),
                                   fmt::format("--lcm-url={}", kNear),
                                   fmt::format("--rule={} -> {} via uplink", kChannel, kFar)};
  for (const std::string& text : overrides) command.push_back("--set=" + text);
  relay_ = std::make_unique<NodeProcess>(
      loop_, std::move(command),
      [this](const std::string& line) {
        said_ += line + "\n";
        running_ = running_ || line.find("running") != std::string::npos;
      },
      [this](int code) {
        if (!ending_) failure_ = fmt::format("tether-netem ended (exit code {})\n{}", code, said_);
        loop_.stop();
      });
  relay_->start();
  run_for(std::chrono::seconds{10}, [this] { return running_; });
  if (!running_) throw std::runtime_error("tether-netem does not start\n" + said_);
}

LiveRelay::~LiveRelay() {
  ending_ = true;
  near_heard_ = nullptr;
  for (Line& line : lines_) line.heard = nullptr;
  relay_->send_signal(SIGINT);
  const Instant end = loop_.now() + std::chrono::seconds{5};
  while (relay_->running() && loop_.now() < end) loop_.run_until(end);
}

void LiveRelay::on_near(Heard heard) {
  near_heard_ = std::move(heard);
  if (!std::exchange(hears_near_, true)) listen(near_, near_heard_);
}

void LiveRelay::listen(UdpmBus& bus, Heard& heard) {
  bus.subscribe(kChannel, kDeepQueue, [&heard](const Message& message) {
    std::uint32_t number = 0;
    std::memcpy(&number, message.bytes.data(), std::min(sizeof number, message.bytes.size()));
    if (heard) heard(number, now_ns());
  });
}

void LiveRelay::send(Way way, std::uint32_t number, std::size_t bytes) {
  bytes_.resize(bytes);
  std::memcpy(bytes_.data(), &number, sizeof number);
  line(way).out.publish(kChannel, bytes_);
}

void LiveRelay::run_for(Duration time, const std::function<bool()>& done) {
  const Instant end = loop_.now() + time;
  while (!done() && loop_.now() < end && failure_.empty()) {
    loop_.run_until(std::min(end, loop_.now() + std::chrono::milliseconds{20}));
    if (loop_.signal() != 0) failure_ = "interrupted";
  }
  if (!failure_.empty()) throw std::runtime_error(failure_);
}

std::int64_t LiveRelay::now_ns() {
  timespec t{};
  clock_gettime(CLOCK_MONOTONIC, &t);
  return t.tv_sec * 1'000'000'000LL + t.tv_nsec;
}

}  // namespace tether::bench
