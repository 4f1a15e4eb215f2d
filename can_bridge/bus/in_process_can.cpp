#include "can_bridge/bus/in_process_can.hpp"

#include <algorithm>
#include <cassert>
#include <utility>

namespace tether {
namespace {

/// Bits that arbitration compares, most significant first: 11 bits of the identifier; then, if it
/// is extended, a recessive bit (IDE) and the other 18.
std::uint32_t arbitration(const CanFrame& frame) {
  constexpr int kMore = 18;
  if (!frame.extended) return frame.id << (kMore + 1);
  const std::uint32_t more = frame.id & ((1U << kMore) - 1);
  return (frame.id >> kMore) << (kMore + 1) | 1U << kMore | more;
}

}  // namespace

InProcessCan::InProcessCan(EventLoop& loop, double bit_rate_bps)
    : loop_(loop), bit_rate_bps_(bit_rate_bps) {
  assert(bit_rate_bps > 0.0);
}

InProcessCan::Port& InProcessCan::add_port() {
  ports_.push_back(std::unique_ptr<Port>(new Port(*this)));
  return *ports_.back();
}

Duration InProcessCan::frame_time(std::uint8_t size, bool extended) const {
  return from_seconds(((extended ? 80.0 : 55.0) + 10.0 * size) / bit_rate_bps_);
}

double InProcessCan::load(Instant since) const {
  const double elapsed_s = to_seconds(loop_.now() - since);
  return elapsed_s > 0.0 ? to_seconds(busy_time_) / elapsed_s : 0.0;
}

void InProcessCan::start_next() {
  if (busy_) return;
  Port* winner = nullptr;
  for (const auto& port : ports_) {
    if (!port->connected() || port->waiting_.empty()) continue;
    if (winner == nullptr ||
        arbitration(port->waiting_.front()) < arbitration(winner->waiting_.front())) {
      winner = port.get();
    }
  }
  if (winner == nullptr) return;
  busy_ = true;
  const CanFrame frame = winner->waiting_.front();
  winner->waiting_.pop_front();
  const Duration time = frame_time(frame.remote ? std::uint8_t{0} : frame.size, frame.extended);
  busy_time_ += time;
  loop_.at(loop_.now() + time, Priority::delivery,
           [this, frame, winner](Instant) { finish(frame, winner); });
}

void InProcessCan::finish(const CanFrame& frame, const Port* sender) {
  busy_ = false;
  if (tap_) tap_(frame);
  for (const auto& port : ports_) {
    if (port.get() != sender) port->receive(frame);
  }
  start_next();
}

bool InProcessCan::Port::send(const CanFrame& frame) {
  const bool accepts = connected() || state_ == CanState::stalled;
  if (!accepts || waiting_.size() >= kQueueFrames) {
    ++send_dropped_;
    return false;
  }
  ++sent_;
  waiting_.push_back(frame);
  bus_.start_next();
  return true;
}

void InProcessCan::Port::on_frame(std::vector<CanFilter> filters, FrameHandler handler) {
  filters_ = std::move(filters);
  frame_handler_ = std::move(handler);
}

void InProcessCan::Port::receive(const CanFrame& frame) {
  if (!connected() || !frame_handler_) return;
  const bool wanted = std::any_of(filters_.begin(), filters_.end(),
                                  [&frame](const CanFilter& f) { return f.passes(frame); });
  if (!wanted) return;
  ++received_;
  frame_handler_(frame);
}

void InProcessCan::Port::set_state(CanState state) {
  if (state == state_) return;
  state_ = state;
  ++state_changes_;
  if (state == CanState::down || state == CanState::absent) waiting_.clear();
  if (state_handler_) state_handler_(state);
  bus_.start_next();
}

bool InProcessCan::Port::restart(std::string& why) {
  if (state_ == CanState::down || state_ == CanState::absent) {
    why = "the interface is " + std::string(to_string(state_));
    return false;
  }
  waiting_.clear();
  set_state(CanState::up);
  return true;
}

void InProcessCan::Port::list(CounterList& out) const {
  out.emplace_back("can.sent", sent_);
  out.emplace_back("can.received", received_);
  out.emplace_back("can.send_dropped", send_dropped_);
  out.emplace_back("can.state_changes", state_changes_);
}

}  // namespace tether
