#pragma once

#include <cstddef>
#include <cstdint>
#include <iterator>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/scenario/section.hpp"
#include "netem/medium/radio_settings.hpp"
#include "netem/medium/scheduled_cell.hpp"

namespace tether {

/// [medium]: the radio that all links share, in front of what [channel] says of each of them.
struct MediumSettings {
  enum class Model {
    none,      ///< every link has air of its own
    dcf,       ///< Wi-Fi, all stations with the same parameters (contention.hpp)
    edca,      ///< Wi-Fi with access categories
    scheduled  ///< a cell that grants its uplink (cell/scheduled_cell.hpp)
  };
  Model model = Model::none;
  bool is_wifi() const { return model == Model::dcf || model == Model::edca; }

  // Wi-Fi.
  bool he = false;                  ///< 802.11ax, HE SU, instead of OFDM of 802.11a/g
  double rate_Mbps = 54.0;          ///< rate of data; in a cell that of all users together
  double control_rate_Mbps = 24.0;  ///< rate of acknowledgements
  std::string category = "VO";      ///< edca: of poses, commands and plans: BK, BE, VI, VO
  bool eifs = true;                 ///< after a collision stations wait as for an acknowledgement
  std::int64_t attempts = 7;        ///< maximum number for a frame (for a transmission in a cell)
  std::int64_t queue = 100;         ///< frames that wait at a station
  double lifetime_ms = 500.0;       ///< frames that have waited for longer are not sent
  double error_ratio = 0.0;         ///< share of attempts lost to noise
  RadioSettings radio = {};

  // A cell.
  std::string preset = "none";  ///< sets those of its keys that are not given
  double request_period_ms = 20.0;
  double offset_ms = 2.5;
  double slot_ms = 0.5;
  double repeat_after_ms = 8.0;
  ScheduledRules::Serve serve = ScheduledRules::Serve::round_robin;
  bool keep_newest = false;  ///< keep = "newest": of vehicles, not of the background

  /// One [[medium.background]]: stations that send, too, or are sent to. Other vehicles, as far as
  /// the radio goes: their poses up, their commands down.
  struct Background {
    enum class Kind { saturated, poisson, periodic };
    Kind kind = Kind::poisson;
    std::int64_t stations = 1;
    double rate_hz = 10.0;        ///< packets a second of each; not of saturated ones
    std::int64_t bytes = 1400;    ///< size of a packet's UDP payload
    std::string category = "BE";  ///< edca
    bool down = false;            ///< way = "down": the access point sends it
    /// With [medium.radio]; not set: the radio's, in a hall no noise but error_ratio.
    std::optional<double> snr_db = {};
  };
  std::vector<Background> background = {};

  /// Other vehicles like the scenario's, as far as the radio goes: each sends `up` and is sent
  /// `down`, in equal periods, each from a random phase on.
  std::int64_t others = 0;
  std::int64_t vehicles = 1;  ///< vehicles of the fleet; no key: it follows from fleet.count
  struct Stream {
    double rate_hz = 0.0;
    std::int64_t bytes = 0;  ///< size of a packet's UDP payload
    double most_hz = 0.0;    ///< with send = "changed", where rate_hz is the least; else 0
    double highest_hz() const { return rate_hz > most_hz ? rate_hz : most_hz; }
  };
  // No keys: they follow from the scenario's other sections.
  bool together = false;      ///< fleet.ticks = "together": vehicles send in the same instant
  Stream up = {}, down = {};  ///< poses; commands or plans
  bool poses_go_up = true;    ///< the fleet's vehicles send poses; false: they are made at the edge
  std::vector<Stream> more_up = {};  ///< further streams: odometry, parts of scans, localisation
};

ScenarioSection medium_section();

/// Size of the UDP payload in which LCM sends a message: magic, number, the channel's name with its
/// end, data.
inline std::int64_t datagram_bytes(std::string_view channel, std::int64_t message_bytes) {
  constexpr std::int64_t kLcmHeader = 8;
  return kLcmHeader + std::ssize(channel) + 1 + message_bytes;
}

/// Load of the packets of all vehicles and of the background, without collisions and repeats;
/// saturated stations, which are always asking, apart. All 0 without a medium.
struct OfferedLoad {
  /// Shares of the medium's time; of a cell, whose ways have a carrier each, that of the busier
  /// way. Beyond 1 it cannot carry them. `most`: if all is sent of what need not be (send =
  /// "changed"): an upper bound.
  double least = 0.0, most = 0.0;
  std::int64_t saturated = 0;  ///< stations; only these share the remaining time
  /// Frames that the access point is to send a second, at most; and as many as it can, where each
  /// saturated station sends one for each of its: all have the same category. Else nullopt.
  double down_hz = 0.0;
  std::optional<double> most_down_hz = {};
};
OfferedLoad offered_load(const MediumSettings& settings);
/// One line if `most` is 1 or more, a station is saturated, or vehicles on Wi-Fi send in the same
/// instant; else "".
std::string medium_warning(const MediumSettings& settings);

}  // namespace tether
