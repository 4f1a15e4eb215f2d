#include <CLI/CLI.hpp>
#include <string>
#include <vector>

#include "common/base/say.hpp"
#include "common/fleet/fleet.hpp"
#include "common/lcm/lcm_url.hpp"
#include "common/lcm/udpm_bus.hpp"
#include "common/program/node_main.hpp"
#include "netem/medium/medium_settings.hpp"
#include "netem/relay/netem_node.hpp"
#include "netem/relay/relay_rule.hpp"

// AGV/POSE ──▶ uplink ──▶ CTRL/POSE,  CTRL/CMD_VEL, PLAN ──▶ downlink ──▶ AGV/…,  reports: NET/…
// With --rule: whatever the rules say instead.
int main(int argc, char** argv) {
  using namespace tether;
  std::vector<std::string> texts;
  std::vector<RelayRule> rules;
  std::string own_url;
  const OwnOptions own{
      [&texts](CLI::App& app) {
        app.add_option(
               "--rule", texts,
               "relay any LCM traffic instead of a vehicle's (repeatable): "
               "'[SRC_URL:]REGEX -> [DST_URL:]RENAME via LINK', LINK being uplink, downlink "
               "or NAME of the scenario's [channel.links.NAME]; needs no scenario")
            ->allow_extra_args(false);
      },
      [&texts] { return !texts.empty(); },
      [&](const Scenario& scenario, const std::string& lcm_url,
          const std::vector<std::string>& overrides) {
        if (texts.empty()) {
          const std::string warning = medium_warning(scenario.get<MediumSettings>());
          if (!warning.empty()) say(Severity::warning, "tether-netem: " + warning);
          return;
        }
        rules = parse_relay_rules(texts, lcm_url, scenario);
        check_overrides(use_of(rules), overrides);
        own_url = checked_lcm_url(lcm_url);
        for (const RelayRule& rule : rules) {
          say(Severity::info, "tether-netem: rule: " + to_text(rule));
        }
      }};
  const auto make = [&](const NodeContext& c) -> std::unique_ptr<Node> {
    if (rules.empty()) {
      return relays_of(fleet_members(c.scenario), c.loop, c.bus, c.control_bus);
    }
    return std::make_unique<RelayNode>(
        c.scenario, rules, c.loop, own_url,
        [&loop = c.loop](const std::string& url) { return std::make_unique<UdpmBus>(url, loop); });
  };
  return node_main(
      argc, argv,
      {.name = "tether-netem",
       .description = "Network emulator between vehicle and controller, or between any LCM "
                      "programs: loss and delay",
       .examples =
           {"tether-netem scenarios/paper.toml --set channel.prr=0.45   # follows SIM/CLOCK",
            "tether-netem --rule 'CAMERA -> CAMERA_LATE via uplink' --set "
            "channel.uplink.delay_ms=50"},
       .joins_two_networks = true,
       .lockstep_name = "netem",
       .make = make,
       .own = own});
}
