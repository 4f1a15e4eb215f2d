#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <tether/channel_setting_result_t.hpp>
#include <tether/clock_t.hpp>
#include <tether/drive_request_t.hpp>
#include <tether/pose_t.hpp>
#include <tether/twist_t.hpp>
#include <utility>
#include <vector>

#include "common/base/time.hpp"
#include "common/node/bus.hpp"
#include "common/node/channel_names.hpp"
#include "common/node/event_loop.hpp"
#include "tools/view/server/hub.hpp"
#include "tools/view/server/view_server.hpp"
#include "tools/view/sources/network_parameters.hpp"

namespace tether {

/// Request of a page to a drivetrain: {"request": "ARM"}, by the constant's name in drive_request_t
/// or its number. Throws UsageError that says what is wrong.
std::int32_t parse_operator_request(std::string_view json);

/// Manual driving: a page's twists are sent as the controller's, stamped as a controller would,
/// and so meet the network as a controller's do. One client drives at a time. Its page repeats each
/// twist as long as its dead man is held; when it falls silent, whatever the reason, zero twists
/// follow for a second, since the vehicle's actuator.policy may be to hold the last.
class HandDrive {
 public:
  /// A twist that is not repeated ends after this.
  static constexpr Duration kHold = std::chrono::milliseconds{250};
  static constexpr Duration kPeriod = std::chrono::milliseconds{50};  ///< period of tick()
  static constexpr double kFastest_mps = 10.0, kFastest_radps = 5.0;

  void hear(const clock_t& clock, Instant now);
  void hear(const pose_t& pose);

  /// Converts {"v_mps": 1, "omega_radps": 0}. Throws UsageError that says why there is none.
  twist_t take(ClientId client, std::string_view json, Instant now);
  /// A zero twist if one is due.
  std::optional<twist_t> tick(Instant now);

 private:
  static constexpr int kZeros = 20;

  twist_t stamped(double v_mps, double omega_radps, Instant now);
  bool is_held(Instant now) const { return driver_ && now - driven_at_ <= kHold; }

  std::optional<clock_t> clock_;
  Instant clock_at_{};
  std::int64_t pose_utime_ = -1;
  std::optional<ClientId> driver_;
  Instant driven_at_{};
  int zeros_ = 0;  ///< still to be sent
  std::int64_t seq_ = 0;
};

/// Shows all that is on a bus, and carries clients' requests to it: settings to the relay by
/// NET/SET, whose answer is sent to the clients; requests to drives go to the bridge. In a fleet,
/// settings go to the links of all vehicles; the clients receive those of the first one. What a
/// client causes is on the bus, and so in a recording.
///
/// In real time or in virtual time; requests are only looked at when on_requests() is called.
class NetworkView {
 public:
  struct Options {
    std::vector<std::string> vehicles = {"AGV"};  ///< at least one
    /// Whether to ask the relay which settings are in force, until it answers. Else
    /// `parameters` says it.
    bool ask_relay = true;
    /// Whether clients may drive: where no controller does.
    bool may_drive = false;
    NetworkParameters parameters = NetworkParameters();
  };
  /// Subscribes; all must outlive it.
  NetworkView(EventLoop& loop, Bus& bus, ViewServer& server, Options options);
  NetworkView(const NetworkView&) = delete;
  NetworkView& operator=(const NetworkView&) = delete;

  /// Takes what it has of clients' requests; true if it was for this.
  bool take(const ViewRequest& request);

  /// On which clients may publish: to the drives of a vehicle that is alone, and twists to the
  /// first one.
  static std::vector<std::string> publishable(const std::vector<std::string>& vehicles,
                                              bool may_drive);

 private:
  struct Pending {
    ClientId client;
    std::optional<std::string> request;
    std::vector<std::string> parameters;
    std::set<std::string> silent = {};                ///< vehicles whose links have not answered
    std::map<std::string, std::string> refused = {};  ///< vehicles, and why
  };
  using RequestName = std::pair<std::int64_t, std::int64_t>;  ///< its utime and seq

  void hear(const Message& message);
  void on_answer(const std::string& vehicle, const channel_setting_result_t& answer);
  std::string outcome(const Pending& pending) const;
  void ask();
  void set(const ViewRequest& request, const std::vector<Parameter>& parameters);
  void operate(const ViewRequest& request, const ViewRequest::Publish& what);
  void hear_for_driving(const Message& message);
  template <class LcmType>
  void send(const std::string& channel, const LcmType& message);
  std::uint64_t time_ns(const Message& message) const;
  std::int64_t relay_utime() const;

  EventLoop& loop_;
  Bus& bus_;
  ViewServer& server_;
  std::vector<std::string> vehicles_;
  ChannelNames channels_;                                    ///< channels of the first
  std::map<std::string, std::string, std::less<>> answers_;  ///< NET/SETTINGS -> vehicle
  NetworkParameters parameters_;
  HandDrive drive_;
  bool may_drive_;
  std::map<RequestName, Pending> pending_;
  std::int64_t seq_;
  std::int64_t bridge_utime_ = 0, bridge_run_ = 0;
  std::int64_t relay_ahead_us_ = 0;  ///< its clock, of ours
  RequestName asked_{};
  bool relay_known_ = false;
};

}  // namespace tether
