#pragma once

#include <string>
#include <tether/all_messages.hpp>
#include <vector>

#include "can_bridge/bus/in_process_can.hpp"
#include "can_bridge/drivetrain/can_settings.hpp"
#include "can_bridge/profiles/profiles.hpp"
#include "common/scenario/scenario.hpp"
#include "common/vehicle/actuator_settings.hpp"
#include "tests/fuzz/fuzz.hpp"
#include "tests/fuzz/script.hpp"
#include "tests/support/source_dir.hpp"
#include "tests/support/virtual_world.hpp"

namespace tether::fuzzing {

using tether::test::VirtualWorld;

/// One of drivetrains/.
inline const DrivetrainConfig& choose_drivetrain(Script& script) {
  static const std::string folder = in_source("/drivetrains/");
  static const std::vector<DrivetrainConfig> all{load_drivetrain(folder + "two_node_cia402.toml"),
                                                 load_drivetrain(folder + "dual_axis_cia402.toml"),
                                                 load_drivetrain(folder + "zlac8015d.toml"),
                                                 load_drivetrain(folder + "agilex_v2.toml")};
  return all[script.choice(all.size())];
}

inline CanFrame next_frame(Script& script) {
  const auto id = script.number<std::uint16_t>();
  CanFrame frame = CanFrame::make(id & 0x7FFu, script.take(id >> 11 & 7u));
  frame.remote = (id & 0x8000) != 0;
  return frame;
}

/// A bus in virtual time, whose participants a script meddles with.
struct CanWorld : VirtualWorld {
  InProcessCan can{loop, 500e3};
  InProcessCan::Port& unknown_sender{can.add_port()};
  const std::vector<std::string> words{"run", "agv", ""};

  /// Messages have the time, this run and numbers that count up, or whatever the script says.
  template <class LcmType>
  void say(Script& script, const std::string& channel) {
    auto message = filled<LcmType>(script, words);
    if (script.byte() % 8 != 0) {
      message.utime = to_utime(loop.now());
      message.seq = ++seq_;
    }
    publish(bus, channel, message);
  }
  void steer(double v_mps) {
    publish(bus, "AGV/CMD_VEL", test::twist(loop.now(), ++seq_, v_mps, 0.0));
  }
  void pass_time(Duration time) { loop.run_until(loop.now() + time); }

 private:
  std::int64_t seq_ = 0;
};

}  // namespace tether::fuzzing
