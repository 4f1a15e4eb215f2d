#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "can_bridge/bus/can_port.hpp"
#include "can_bridge/bus/link_control.hpp"
#include "can_bridge/bus/link_service.hpp"
#include "common/node/event_loop.hpp"

namespace tether {

/// Queries and changes one network interface, by name, and learns of its changes. A change that the
/// kernel does not permit to this program is made by the CanLinkService of this machine, if it
/// runs.
class CanLinkMonitor {
 public:
  /// `service`: the socket of the CanLinkService.
  CanLinkMonitor(std::string interface, std::string service);
  ~CanLinkMonitor();
  CanLinkMonitor(const CanLinkMonitor&) = delete;
  CanLinkMonitor& operator=(const CanLinkMonitor&) = delete;

  /// nullopt: there is no such interface.
  std::optional<CanLink> query() const { return control_.query(interface_); }

  /// Readable when a link of this machine may have changed: then call drain().
  int fd() const { return events_fd_; }

  /// Changes of an interface; it may be over already.
  struct Changes {
    bool deleted = false;
    bool was_down = false;
  };
  /// Reads all that is readable, and returns what it says of the interface of that index.
  Changes drain(int index) const;

  /// 0, or the errno why not: EPERM without CAP_NET_ADMIN and without a CanLinkService.
  int change(int index, LinkChange change) const;

 private:
  std::string interface_;
  std::string service_;
  CanLinkControl control_;
  int events_fd_ = -1;
};

}  // namespace tether

struct can_frame;

namespace tether {

/// A raw socket of Linux's SocketCAN (Documentation/networking/can.rst of the kernel) on one
/// interface: a CAN adapter ("can0") or a virtual bus ("vcan0"). Needs a loop in real time.
///
/// Sending. At most a handful of frames (about 7, SO_SNDBUF's minimum) wait in the kernel; more are
/// dropped and counted. Every program on this machine hears them; they do not come back.
///
/// Receiving. The kernel passes classic 11-bit data frames that match the filters, nothing else: no
/// 29-bit, remote or CAN FD frames. Before on_frame() nothing is received. Frames that the kernel
/// had to drop because this program was slow are counted in can.rx_overflow.
///
/// State
/// - error_passive, bus_off: from the controller's error frames, confirmed by what rtnetlink says
///   about the controller, because any program on this machine can inject error frames. A frame
///   that says bus-off when the controller denies it is counted (can.error_frames_unconfirmed) and
///   not believed. A virtual bus has no controller to ask. There the frame is believed until the
///   interface was down, because stopping without need is the safer mistake.
/// - bus_off: nothing is sent, since the kernel would take frames and keep them for later.
/// - stalled: for more than kStallTime no frame could be handed over although it was tried. Frames
///   that were accepted before still wait, and would go out, late, when the bus recovers: call
///   restart() at once. Left by restart(), or when a frame is accepted again.
/// - down, absent: followed by rtnetlink. That it was down is reported even if it was for a moment,
///   but not for the port's own restart(). An interface that is created again is opened again, with
///   the same filters (can.reopened).
class SocketCanPort final : public CanPort {
 public:
  static constexpr Duration kStallTime = std::chrono::milliseconds{60};

  /// The interface has to exist; it may be down. Throws UsageError for what cannot be an
  /// interface's name, std::runtime_error that says what to do if kernel or interface are missing.
  /// `link_service`: the socket of the CanLinkService that restart() asks without CAP_NET_ADMIN.
  SocketCanPort(const std::string& interface, EventLoop& loop,
                const std::string& link_service = kCanLinkService);
  ~SocketCanPort() override;

  bool send(const CanFrame& frame) override;
  void on_frame(std::vector<CanFilter> filters, FrameHandler handler) override;
  void on_state(StateHandler handler) override { state_handler_ = std::move(handler); }
  CanState state() const override { return state_; }

  /// Needs CAP_NET_ADMIN or a CanLinkService. Not for an interface that is absent, or that another
  /// program else took down. Takes as long as the adapter does: with a dead serial or USB adapter
  /// seconds. That one may then stay down, with empty queues, until it answers at a later
  /// restart().
  bool restart(std::string& why) override;

  /// Without CAP_NET_ADMIN and CanLinkService; "" for a virtual bus, which never stalls.
  std::string warning() const override;

  /// Appends can.sent, can.received, can.send_dropped, can.rx_overflow (frames), can.malformed
  /// (frames of impossible length), can.error_frames, can.error_frames_unconfirmed, can.restarts,
  /// can.reopened, can.state_changes.
  void list(CounterList& out) const override;

 private:
  struct Counters {
    std::int64_t sent = 0;
    std::int64_t received = 0;
    std::int64_t send_dropped = 0;
    std::int64_t rx_overflow = 0;
    std::int64_t malformed = 0;
    std::int64_t error_frames = 0;
    std::int64_t error_frames_unconfirmed = 0;
    std::int64_t restarts = 0;
    std::int64_t reopened = 0;
    std::int64_t state_changes = 0;
  };
  void open(const CanLink& link);
  void close_socket();
  void apply_filters() const;
  void read_frames();
  bool read_frame();
  void accept(const can_frame& frame);
  void on_error_frame(const can_frame& frame);
  void on_failed_send(int error);
  void on_link_change();
  CanLink::Controller follow_link(bool deleted);
  void forget_failures();
  void set_state();

  std::string interface_;
  EventLoop& loop_;
  CanLinkMonitor monitor_;
  std::vector<CanFilter> filters_;
  FrameHandler frame_handler_;
  StateHandler state_handler_;

  int fd_ = -1;
  CanLink link_;  // last known state; meaningful while fd_ is open
  CanState state_ = CanState::up;
  // Without a controller to ask, what error frames said since the interface was last down.
  CanLink::Controller suspicion_ = CanLink::Controller::active;
  bool send_fails_ = false;
  bool stalled_ = false;
  Instant send_fails_since_{};
  bool half_restarted_ = false;      // restart() took the interface down, and could not take it up
  std::uint32_t overflow_seen_ = 0;  // overflows of this socket
  Counters counters_;
};

}  // namespace tether
