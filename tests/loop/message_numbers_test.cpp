#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>
#include <map>
#include <string>
#include <tether/all_messages.hpp>
#include <tuple>
#include <type_traits>
#include <vector>

#include "common/fleet/fleet.hpp"
#include "common/node/message_io.hpp"
#include "common/scenario/scenario.hpp"
#include "tests/support/source_dir.hpp"
#include "tools/nodes/closed_loop.hpp"
#include "tools/runs/run_observer.hpp"

// Every number of every message that a closed loop sends is repeated with 0, −1, huge, tiny and
// undefined values, as by a peer that is broken: no node ends, and what the run says is numbers.

namespace tether {
namespace {

using Bytes = std::vector<std::uint8_t>;
using std::chrono::milliseconds;

constexpr Instant kBegin = kStart + milliseconds{1200};  // all have published
constexpr Duration kBetween = milliseconds{50};

struct Base {
  std::string file;
  std::vector<std::string> overrides;
};

const std::vector<Base>& bases() {
  static const std::vector<Base> kBases{
      {"paper.toml",
       {"vehicle.plant=kinematic", "sensor.rate_hz=20", "sensor.odometry_rate_hz=50"}},
      {"paper.toml",
       {"vehicle.plant=kinematic", "sensor.rate_hz=20", "controller.law=mpc",
        "actuator.policy=horizon", "controller.estimator=ekf"}},
      {"hil_vcan.toml", {}},
      {"factory_blocked.toml", {"vehicle.plant=kinematic"}},
      {"warehouse_wifi.toml", {"vehicle.plant=kinematic", "fleet.count=2"}}};
  return kBases;
}

constexpr std::array kReals{0.0,
                            -1.0,
                            1e308,
                            -1e308,
                            1e-308,
                            std::numeric_limits<double>::quiet_NaN(),
                            std::numeric_limits<double>::infinity(),
                            -std::numeric_limits<double>::infinity()};
constexpr std::size_t kTried = kReals.size();

/// The i-th extreme value of a kind of number.
template <class Number>
Number extreme(std::size_t i) {
  if constexpr (std::is_floating_point_v<Number>) {
    return static_cast<Number>(kReals[i]);
  } else {
    using Limits = std::numeric_limits<Number>;
    constexpr std::array<Number, kTried> kIntegers{0,
                                                   -1,
                                                   Limits::max(),
                                                   Limits::min(),
                                                   1,
                                                   Limits::max() - 1,
                                                   Limits::min() + 1,
                                                   Limits::max() / 2};
    return kIntegers[i];
  }
}

/// The i-th extreme value in place of a number, or of the first of a list.
template <class Field>
bool change(Field& field, std::size_t i) {
  if constexpr (std::is_arithmetic_v<Field>) {
    field = extreme<Field>(i);
    return true;
  } else if constexpr (std::is_same_v<Field, std::string>) {
    return false;
  } else if constexpr (std::is_arithmetic_v<std::remove_cvref_t<decltype(field[0])>>) {
    if (std::begin(field) == std::end(field)) return false;
    field[0] = extreme<std::remove_cvref_t<decltype(field[0])>>(i);
    return true;
  } else {
    return false;
  }
}

/// A message whose numbered field has the i-th extreme value, and is else the successor of the one
/// given; empty if that field has no number, or the bytes are not of this type.
template <class LcmType>
Bytes changed(const Bytes& bytes, int number, std::size_t i, std::string& name) {
  LcmType message{};
  if (!decode(std::span<const std::uint8_t>(bytes), message)) return {};
  bool done = false;
  int field = 0;
  visit_fields(message, [&](const char* says, auto& x, auto...) {
    if (field++ == number) {
      name = says;
      done = change(x, i);
    } else if constexpr (std::is_same_v<decltype(x), std::int64_t&>) {
      // Each is newer than the one before it, so that it is not left as a copy.
      const auto ahead = static_cast<std::int64_t>(i) + 1;
      if (std::string(says) == "seq") x += ahead;
      if (std::string(says) == "utime") x += 1000 * ahead;
    }
  });
  if (!done) return {};
  Bytes out(static_cast<std::size_t>(message.getEncodedSize()));
  message.encode(out.data(), 0, static_cast<int>(out.size()));
  return out;
}

template <class... LcmTypes>
struct Each {
  static Bytes try_all(const Bytes& bytes, int number, std::size_t i, std::string& name) {
    Bytes out;
    ((out.empty() ? void(out = changed<LcmTypes>(bytes, number, i, name)) : void()), ...);
    return out;
  }
  static int fields(const Bytes& bytes) {
    int count = 0;
    const auto count_of = [&](auto message) {
      if (!decode(std::span<const std::uint8_t>(bytes), message)) return;
      visit_fields(message, [&](const char*, auto&, auto...) { ++count; });
    };
    (count_of(LcmTypes{}), ...);
    return count;
  }
};
using All = AllMessages<Each>;

using Newest = std::map<std::string, Bytes, std::less<>>;

void listen(Bus& bus, Newest& newest) {
  bus.subscribe(".*", kDeepQueue, [&newest](const Message& message) {
    newest[std::string(message.channel)].assign(message.bytes.begin(), message.bytes.end());
  });
}

/// A run to which the channel's messages with an extreme value of one field are said as well; how
/// many were. Throws what a node throws.
int attacked(const Scenario& scenario, const std::string& channel, int number, std::string& name) {
  ClosedLoop loop(scenario);
  const FleetObserver observer(fleet_members(scenario), loop.loop(), loop.bus());
  Newest newest;
  listen(loop.bus(), newest);
  int said = 0;
  for (std::size_t i = 0; i < kTried; ++i) {
    loop.loop().at(kBegin + static_cast<int>(i) * kBetween, Priority::node, [&, i](Instant) {
      const Bytes bytes = All::try_all(newest[channel], number, i, name);
      if (bytes.empty()) return;
      ++said;
      loop.bus().publish(channel, bytes);
    });
  }
  loop.run();
  observer.check_finite();
  return said;
}

TEST(MessageNumbers, OfEachFieldOfEachChannelLeaveEachNodeAndTheResultsNumbers) {
  int channels = 0, fields = 0, messages = 0;
  for (const auto& [file, more] : bases()) {
    std::vector<std::string> overrides = more;
    overrides.emplace_back("run.duration_s=1.8");
    const Scenario scenario = load_scenario(in_source("/scenarios/" + file), overrides);
    Newest newest;
    {
      ClosedLoop loop(scenario);
      listen(loop.bus(), newest);
      loop.run_until(kBegin);
    }
    for (const auto& [channel, bytes] : newest) {
      ++channels;
      for (int number = All::fields(bytes); number-- > 0;) {
        std::string name;
        try {
          const int said = attacked(scenario, channel, number, name);
          fields += said > 0 ? 1 : 0;
          messages += said;
        } catch (const std::exception& e) {
          ADD_FAILURE() << file << ", " << channel << ", " << name << ": " << e.what();
        }
      }
    }
  }
  std::printf("measured: %d messages of %d fields on %d channels\n", messages, fields, channels);
  EXPECT_GT(fields, 800);
  EXPECT_GT(messages, fields * 7) << "lists are empty now and then";
}

}  // namespace
}  // namespace tether
