// The same cell as ns3_wifi.cpp's, by Tether's shared medium, with the same options and the same
// JSON line.

#include "netem/medium/shared_medium.hpp"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <functional>
#include <map>
#include <memory>
#include <queue>
#include <string>
#include <utility>
#include <vector>

#include "netem/medium/wifi_airtime.hpp"
#include "netem/medium/wifi_stations.hpp"

namespace tether {
namespace {

using std::chrono::milliseconds;

struct Options {
  int stations = 5;
  std::string pattern = "saturated";
  int up_bytes = 1500, down_bytes = 137;  ///< MAC frame with header and FCS
  double seconds = 1.0;
  std::uint64_t seed = 1;
  bool eifs = true;
};

constexpr Instant kCounts = kStart + std::chrono::seconds{2};

/// Frames of saturated stations, up.
std::int64_t saturated(const Options& options, const MediumSettings& settings) {
  WifiStations cell(settings, options.seed, [](const FrameEnd&) {});
  const auto delivered_by = [&](Instant t) {
    while (cell.next_event() <= t) cell.advance(cell.next_event());
    return cell.counters().delivered;
  };
  const std::int64_t before = delivered_by(kCounts);
  return delivered_by(kCounts + from_seconds(options.seconds)) - before;
}

/// Poses of 20 a second from random phases on, each answered at once when it arrives.
class Loop {
 public:
  Loop(const Options& options, const MediumSettings& settings)
      : options_(options),
        medium_(SharedMedium::make(settings, options.seed,
                                   [this](const PacketFateOnAir& fate) { ended_.push(fate); })) {
    RandomEngine random = random_stream(options.seed, "phases");
    for (int i = 0; i < options.stations; ++i) {
      poses_.emplace(kStart + from_seconds(0.05 * uniform_01(random)),
                     medium_->add_vehicle(fmt::format("AGV{}", i + 1)));
    }
  }

  void run() {
    const Instant end = kCounts + from_seconds(options_.seconds);
    while (true) {
      const Instant now = std::min(poses_.top().first, medium_->next_event());
      if (now > end + milliseconds{600}) return;
      medium_->advance(now);
      while (!ended_.empty()) {
        on_end(std::exchange(ended_.front(), {}));
        ended_.pop();
      }
      if (poses_.top().first > now) continue;
      const std::size_t vehicle = poses_.top().second;
      poses_.pop();
      poses_.emplace(now + milliseconds{50}, vehicle);
      send(now, vehicle, Way::up);
    }
  }

  std::string json(Way way) {
    Sent& s = way == Way::up ? up_ : down_;
    std::sort(s.delays_us.begin(), s.delays_us.end());
    double sum = 0.0;
    for (const double d : s.delays_us) sum += d;
    const auto n = static_cast<double>(s.delays_us.size());
    return fmt::format(R"({{"sent": {}, "delivered": {}, "mean_us": {}, "p95_us": {}}})", s.all,
                       s.delays_us.size(), n > 0.0 ? sum / n : 0.0,
                       n > 0.0 ? s.delays_us[static_cast<std::size_t>(0.95 * n)] : 0.0);
  }

 private:
  struct Sent {
    std::int64_t all = 0;
    std::vector<double> delays_us;
  };
  struct Packet {
    Instant sent;
    std::size_t vehicle;
    Way way;
    bool counts;
  };
  void send(Instant now, std::size_t vehicle, Way way) {
    // Frames have 28 bytes of IP and UDP here, and a header of QoS data.
    const int frame = way == Way::up ? options_.up_bytes : options_.down_bytes;
    const bool counts = now >= kCounts && now < kCounts + from_seconds(options_.seconds);
    (way == Way::up ? up_ : down_).all += counts ? 1 : 0;
    packets_[id_] = {now, vehicle, way, counts};
    medium_->send(now, vehicle, way, id_++, frame - 28 - kWifiOverheadBytes);
  }
  void on_end(const PacketFateOnAir& fate) {
    const Packet packet = packets_.extract(fate.id).mapped();
    if (!fate.delivered) return;
    if (packet.counts) {
      (packet.way == Way::up ? up_ : down_)
          .delays_us.push_back(to_milliseconds(fate.at - packet.sent) * 1e3);
    }
    if (packet.way == Way::up) send(fate.at, packet.vehicle, Way::down);
  }

  Options options_;
  std::queue<PacketFateOnAir> ended_;
  std::unique_ptr<SharedMedium> medium_;
  using Pose = std::pair<Instant, std::size_t>;  ///< when, and of which vehicle
  std::priority_queue<Pose, std::vector<Pose>, std::greater<>> poses_;
  std::map<std::uint64_t, Packet> packets_;
  std::uint64_t id_ = 0;
  Sent up_, down_;
};

void print(const Options& options) {
  MediumSettings settings;
  settings.model = MediumSettings::Model::dcf;
  settings.eifs = options.eifs;
  if (options.pattern == "saturated") {
    settings.background.push_back({.kind = MediumSettings::Background::Kind::saturated,
                                   .stations = options.stations,
                                   .bytes = options.up_bytes - 28 - kWifiOverheadBytes});
    fmt::print("{{\"up\": {{\"delivered\": {}}}}}\n", saturated(options, settings));
    return;
  }
  Loop loop(options, settings);
  loop.run();
  fmt::print("{{\"up\": {}, \"down\": {}}}\n", loop.json(Way::up), loop.json(Way::down));
}

}  // namespace
}  // namespace tether

int main(int argc, char** argv) {
  tether::Options options;
  CLI::App app("The cell of ns3_wifi, by Tether's shared medium.");
  app.add_option("--stations", options.stations);
  app.add_option("--pattern", options.pattern);
  app.add_option("--up", options.up_bytes);
  app.add_option("--down", options.down_bytes);
  app.add_option("--seconds", options.seconds);
  app.add_option("--seed", options.seed);
  app.add_option("--eifs", options.eifs);
  CLI11_PARSE(app, argc, argv);
  tether::print(options);
}
