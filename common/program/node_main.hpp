#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "common/node/bus.hpp"
#include "common/node/event_loop.hpp"
#include "common/node/node.hpp"
#include "common/scenario/scenario.hpp"

namespace CLI {  // NOLINT(readability-identifier-naming)
class App;
}

namespace tether {

/// Arguments of a node, from its program.
struct NodeContext {
  const Scenario& scenario;
  EventLoop& loop;
  Bus& bus;  ///< the vehicle's side of the network
  Bus&
      control_bus;  ///< the controller's side; the same bus unless --control-lcm-url says otherwise
};

/// How long a node may take to wind down (Node::wind_down), at the very most.
inline constexpr Duration kWindDownLimit = std::chrono::seconds{21};

/// Options that only one program has. They may make it stand alone: it then needs no scenario,
/// starts a clock of its own instead of joining a run, and has no --control-lcm-url.
struct OwnOptions {
  std::function<void(CLI::App&)> add = [](CLI::App&) {};
  /// Asked after parsing.
  std::function<bool()> stand_alone = [] { return false; };
  /// Throws UsageError for what is wrong with them; before any network is opened. `overrides`: the
  /// values of --set.
  std::function<void(const Scenario&, const std::string& lcm_url,
                     const std::vector<std::string>& overrides)>
      check = [](const Scenario&, const std::string&, const std::vector<std::string>&) {};
};

struct NodeProgram {
  std::string name;                   ///< "tether-sim"
  std::string description;            ///< first line of --help
  std::vector<std::string> examples;  ///< last lines of --help
  bool joins_two_networks = false;    ///< has --control-lcm-url
  bool owns_clock = false;  ///< without --start-utime: starts the run's clock instead of following
  std::string lockstep_name{};  ///< a name in lockstep_nodes(); has --lockstep if not empty; has
                                ///< --lockstep if not empty
  std::function<std::unique_ptr<Node>(const NodeContext&)> make;
  OwnOptions own{};
};

/// The main() of every node: options, scenario, real-time loop, LCM, orderly end on SIGINT and
/// SIGTERM. Without --start-utime the node waits for SIM/CLOCK and takes the run's time from it
/// (and starts over if that clock jumps, as when a simulator is restarted or a log is played
/// again); the simulator itself starts a run at once. A node that has to wind down does so before
/// the program ends or starts over, whatever further signals come.
///
/// With --lockstep the node lives in simulated time instead, which a coordinator grants
/// (docs/reference/time.md).
int node_main(int argc, char** argv, const NodeProgram& program);

}  // namespace tether
