#pragma once

#include <functional>

#include "common/base/time.hpp"
#include "tools/view/server/playback.hpp"
#include "tools/view/server/view_server.hpp"
#include "tools/view/sources/network_view.hpp"

namespace tether {

/// A run in virtual time that is computed as it is looked at: at the pace that clients ask for, and
/// no faster. Each thing that they ask of the network is done between two events, so that a run
/// without requests is the same as without a viewer.
class PacedRun {
 public:
  /// Computes all up to an instant of the run.
  using RunUntil = std::function<void(Instant)>;

  /// Begins at `speed` seconds of the run per second.
  PacedRun(Instant start, Instant end, double speed, ViewServer& server, NetworkView& network);

  /// Returns at the end of the run.
  void run(const RunUntil& run_until);

 private:
  void take_requests();
  void take(const ViewRequest& request);
  void set(const Parameter& parameter);
  void wait();
  void tell();

  Instant start_, end_;
  ViewServer& server_;
  NetworkView& network_;
  Playback playback_;
  Instant computed_;
  Instant told_;
};

}  // namespace tether
