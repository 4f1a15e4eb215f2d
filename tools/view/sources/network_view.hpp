#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <tether/channel_setting_result_t.hpp>
#include <utility>
#include <vector>

#include "common/bus/bus.hpp"
#include "common/bus/channel_names.hpp"
#include "common/loop/event_loop.hpp"
#include "tools/view/sources/hand_drive.hpp"
#include "tools/view/sources/network_parameters.hpp"
#include "tools/view/web/view_server.hpp"

namespace tether {

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
