#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/base/random.hpp"
#include "common/node/bus.hpp"
#include "common/node/event_loop.hpp"
#include "common/vehicle/plan.hpp"
#include "tests/campaign/trial.hpp"

namespace tether::campaign {

/// Knowledge of controllers and operators about the vehicle.
struct Heard {
  std::int32_t state = 0;
  Instant since;  ///< it is in this state
  PlanName plan;
};

/// The network between controllers and vehicle, with its faults.
class Network {
 public:
  Network(const Trial& trial, EventLoop& loop, Bus& bus);

  void send(const std::string& channel, std::vector<std::uint8_t> bytes);
  void begin(const Fault& fault);
  void end(const Fault& fault);
  /// Once more something that was sent before.
  void replay(double share);

 private:
  struct Sent {
    std::string channel;
    std::vector<std::uint8_t> bytes;
  };
  void deliver_later(Duration delay, const Sent& sent);

  EventLoop& loop_;
  Bus& bus_;
  RandomEngine random_;
  double delay_s_;
  double loss_ = 0.0;
  double extra_s_ = 0.0;
  double duplicates_ = 0.0;
  std::vector<Sent> sent_;
};

/// Fault of a message from an unknown sender.
struct Forgery {
  bool session = false;
  bool nan = false;
  bool huge = false;
  bool future = false;
  bool number = false;
};

/// Sends twists or plans: zero until the vehicle is armed, then motion that changes now and then.
class Controller {
 public:
  Controller(const Trial& trial, const std::string& name, EventLoop& loop, Network& network,
             const Heard& heard);

  /// Once a period.
  void step();
  /// One that differs from the newest in what is said, with its number.
  void forge(const Forgery& forgery);
  void restart();

  bool silent = false;
  std::optional<Instant> frozen;  ///< the newest pose that it gets, if it gets no more

 private:
  void choose_twist(Instant now);
  std::int64_t pose_utime(Instant now) const;
  void send_twist(const Forgery& forgery);
  void send_plan(const Forgery& forgery);

  const Trial& trial_;
  EventLoop& loop_;
  Network& network_;
  const Heard& heard_;
  RandomEngine random_;
  Twist wanted_;
  Twist said_;
  Instant next_change_ = kStart;
  std::int64_t seq_ = 0;
  std::int64_t session_;
};

/// Sends requests to the bridge, up to 20 ms on their way and `late`. Arms, releases and resets
/// whenever that is what the vehicle needs.
class Operator {
 public:
  Operator(const Trial& trial, EventLoop& loop, Bus& bus, const Heard& heard);

  /// Every 20 ms.
  void step();
  void request(std::int32_t kind, Duration late = {});
  void replay(double share);

 private:
  void send(const std::vector<std::uint8_t>& bytes, Duration late);

  const Trial& trial_;
  EventLoop& loop_;
  Bus& bus_;
  const Heard& heard_;
  RandomEngine random_;
  Instant next_ = kStart;
  bool released_ = false;
  std::int64_t seq_ = 0;
  std::vector<std::vector<std::uint8_t>> sent_;
};

}  // namespace tether::campaign
