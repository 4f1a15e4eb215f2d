#include <CLI/CLI.hpp>
#include <deque>
#include <fstream>
#include <iterator>
#include <optional>
#include <string>
#include <vector>

#include "common/base/errors.hpp"
#include "common/base/say.hpp"
#include "common/fleet/fleet.hpp"
#include "common/program/node_main.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "doors/ip/node/floor_host.hpp"
#include "doors/ip/node/floor_state.hpp"
#include "doors/ip/node/tun_node.hpp"
#include "netem/medium/medium_settings.hpp"

namespace {

using namespace tether;

struct Floor {
  std::optional<ip::FloorState> state;
  std::optional<ip::FloorPlan> plan;
  std::deque<ip::FloorHost> hosts;
};

void make_hosts(const Scenario& scenario, const std::string& folder, int mtu, Floor& floor) {
  std::vector<std::string> names;
  for (const Scenario& member : fleet_members(scenario)) {
    names.push_back(member.get<VehicleSettings>().name);
  }
  floor.plan.emplace(names);
  floor.state.emplace(folder);
  const auto file = floor.state->folder() / "hosts";
  std::ifstream host_names("/etc/hosts");
  std::ofstream(file) << std::string(std::istreambuf_iterator<char>(host_names), {})
                      << floor.plan->hosts_file();
  for (std::size_t host = 0; host < floor.plan->size(); ++host) {
    floor.hosts.emplace_back(ip::FloorHost::Settings{floor.plan->name(host),
                                                     ip::FloorPlan::address(host), mtu,
                                                     std::filesystem::absolute(file)});
  }
}

}  // namespace

// control: tether0 ◀── downlink ◀▶ uplink ──▶ AGV: tether0,  reports: NET/IP_UPLINK,
// NET/IP_DOWNLINK
int main(int argc, char** argv) {
  std::string folder = ip::default_floor_folder().string(), record;
  int mtu = 1500;
  Floor floor;
  const OwnOptions own{
      [&](CLI::App& app) {
        app.add_option("--floor", folder,
                       "folder of the running floor's state [$XDG_RUNTIME_DIR/tether-floor]");
        app.add_option("--mtu", mtu, "largest IP packet of the hosts' devices, bytes")
            ->check(CLI::Range(576, 65'535))
            ->capture_default_str();
        app.add_option("--record", record,
                       "existing folder for the fate of each packet: NAME-uplink.csv and "
                       "NAME-downlink.csv, for `tether netem fit` and the trace model");
      },
      [] { return true; },
      [&](const Scenario& scenario, const std::string&, const std::vector<std::string>&) {
        const std::string warning = medium_warning(scenario.get<MediumSettings>());
        if (!warning.empty()) say(Severity::warning, "tether-tun: " + warning);
        make_hosts(scenario, folder, mtu, floor);
      }};
  const auto make = [&](const NodeContext& c) -> std::unique_ptr<Node> {
    auto node = std::make_unique<ip::TunNode>(
        fleet_members(c.scenario), *floor.plan, record, c.loop, c.bus,
        [&](std::size_t host, const std::vector<std::uint8_t>& packet) {
          return floor.hosts[host].write_packet(packet);
        });
    std::vector<ip::HostEntry> entries;
    for (std::size_t host = 0; host < floor.hosts.size(); ++host) {
      c.loop.add_fd(floor.hosts[host].tun(), [&floor, host, to = node.get()](Instant) {
        constexpr int kMostAtOnce = 64;
        floor.hosts[host].read_packets(kMostAtOnce, [&](std::vector<std::uint8_t> packet) {
          to->take(host, std::move(packet));
        });
      });
      entries.push_back({floor.plan->name(host), ip::to_text(ip::FloorPlan::address(host)),
                         floor.hosts[host].process()});
    }
    floor.state->write(entries);
    return node;
  };
  return node_main(argc, argv,
                   {.name = "tether-tun",
                    .description = "IP network between a control room and vehicles, each a host of "
                                   "its own, through the scenario's channel or medium",
                    .examples = {"tether-tun scenarios/paper.toml --set channel.prr=0.9   # then: "
                                 "tether floor exec AGV -- ping control"},
                    .make = make,
                    .own = own});
}
