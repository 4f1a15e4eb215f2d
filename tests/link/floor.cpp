// A bad network for the UDP of two hosts: link_floor SCENARIO NEAR_BIND NEAR FAR_BIND FAR
// What comes from NEAR (an address with a port) to NEAR_BIND leaves for FAR from FAR_BIND, as the
// scenario's downlink has it, and back by its uplink.
#include <CLI/CLI.hpp>
#include <array>
#include <string>

#include "common/node/real_time_loop.hpp"
#include "common/program/cli.hpp"
#include "common/scenario/scenario.hpp"
#include "doors/link/node/link_node.hpp"
#include "netem/relay/make_links.hpp"
#include "netem/relay/running_link.hpp"

namespace {

using namespace tether;

/// One direction.
struct Direction {
  Direction(Link link, EventLoop& loop, link::PathSocket& out, link::Address to)
      : scheduled(std::move(link), loop, [&out, to](const Packet& p) { out.send(to, p.bytes); }) {}
  ScheduledLink scheduled;
};

int run(const std::string& scenario_file, const std::array<std::string, 4>& addresses) {
  const Scenario scenario = load_scenario(scenario_file, {});
  RealTimeLoop loop(RealTimeLoop::wall_utime_us());
  const auto address = [&](std::size_t i) { return link::address_from_text(addresses[i]); };
  link::PathSocket near({"near", address(0), ""}), far({"far", address(2), ""});
  LinkPair links = make_links(scenario);
  Direction down(std::move(links.downlink), loop, far, address(3));
  Direction up(std::move(links.uplink), loop, near, address(1));
  const auto forward = [&](link::PathSocket& from, Direction& by) {
    loop.add_fd(from.fd(), [&](Instant) {
      from.receive([&](const link::Address&, link::ByteView datagram, std::int64_t) {
        by.scheduled.take({"", {datagram.begin(), datagram.end()}});
      });
    });
  };
  forward(near, down);
  forward(far, up);
  loop.run();
  return kExitOk;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("A bad network for UDP between two hosts", "link_floor");
  std::string scenario;
  std::array<std::string, 4> addresses;
  app.add_option("scenario", scenario)->required();
  const std::array<const char*, 4> names{"near_bind", "near", "far_bind", "far"};
  for (std::size_t i = 0; i < names.size(); ++i) {
    app.add_option(names[i], addresses[i])->required();
  }
  return run_cli(app, argc, argv, [&] { return run(scenario, addresses); });
}
