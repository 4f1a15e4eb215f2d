#pragma once

#include <deque>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "can_bridge/bus/can_port.hpp"
#include "common/node/bus.hpp"
#include "common/node/event_loop.hpp"

namespace tether::campaign {

/// A process that can be suspended: what happens to it meanwhile happens when it goes on, in order.
/// The clock goes on all the time. While it does not live, nothing happens to it at all.
class Process {
 public:
  void run(std::function<void()> task) {
    if (!lives_) return;
    if (suspended_) {
      waiting_.push_back(std::move(task));
    } else {
      task();
    }
  }
  void suspend() { suspended_ = true; }
  void go_on() {
    suspended_ = false;
    while (!waiting_.empty()) {
      const auto task = std::move(waiting_.front());
      waiting_.pop_front();
      task();
    }
  }
  void set_alive(bool lives) {
    lives_ = lives;
    waiting_.clear();
  }
  bool runs() const { return lives_ && !suspended_; }

 private:
  bool lives_ = true;
  bool suspended_ = false;
  std::deque<std::function<void()>> waiting_;
};

/// Its event loop. The rate is that of real time, as nodes ask for it to choose their pace.
class ProcessLoop final : public EventLoop {
 public:
  ProcessLoop(Process& process, EventLoop& loop) : process_(process), loop_(loop) {}

  Instant now() const override { return loop_.now(); }
  double rate() const override { return 1.0; }
  void at(Instant when, Priority priority, Task task) override {
    loop_.at(when, priority, in_process(std::move(task)));
  }
  void every(Instant first, Duration period, Priority priority, Task task) override {
    loop_.every(first, period, priority, in_process(std::move(task)));
  }
  void add_fd(int fd, Task task) override { loop_.add_fd(fd, std::move(task)); }
  void remove_fd(int fd) override { loop_.remove_fd(fd); }
  void stop() override { loop_.stop(); }
  std::uint64_t slips() const override { return loop_.slips(); }

 private:
  Task in_process(Task task) {
    return [this, task = std::move(task)](Instant scheduled) {
      if (process_.runs()) return task(scheduled);
      process_.run([task, scheduled] { task(scheduled); });
    };
  }

  Process& process_;
  EventLoop& loop_;
};

/// Its connection to the bus. `witness` sees what it receives, when it does.
class ProcessBus final : public Bus {
 public:
  ProcessBus(Process& process, Bus& bus, Handler witness)
      : process_(process), bus_(bus), witness_(std::move(witness)) {}

  void publish(std::string_view channel, std::span<const std::uint8_t> bytes) override {
    bus_.publish(channel, bytes);
  }
  void subscribe(const std::string& regex, int capacity, Handler handler) override {
    bus_.subscribe(regex, capacity, [this, handler = std::move(handler)](const Message& m) {
      process_.run([this, &handler, channel = std::string(m.channel),
                    bytes = std::vector<std::uint8_t>(m.bytes.begin(), m.bytes.end())] {
        witness_({channel, bytes});
        handler({channel, bytes});
      });
    });
  }

 private:
  Process& process_;
  Bus& bus_;
  Handler witness_;
};

/// Its CAN port. `witness` sees what it sends.
class ProcessPort final : public CanPort {
 public:
  ProcessPort(Process& process, CanPort& port, FrameHandler witness)
      : process_(process), port_(port), witness_(std::move(witness)) {}

  bool send(const CanFrame& frame) override {
    witness_(frame);
    return port_.send(frame);
  }
  void on_frame(std::vector<CanFilter> filters, FrameHandler handler) override {
    port_.on_frame(std::move(filters), [this, handler = std::move(handler)](const CanFrame& f) {
      if (process_.runs()) return handler(f);
      process_.run([&handler, f] { handler(f); });
    });
  }
  void on_state(StateHandler handler) override {
    port_.on_state([this, handler = std::move(handler)](CanState state) {
      process_.run([&handler, state] { handler(state); });
    });
  }
  CanState state() const override { return port_.state(); }
  bool restart(std::string& why) override { return port_.restart(why); }
  void list(CounterList& out) const override { port_.list(out); }

 private:
  Process& process_;
  CanPort& port_;
  FrameHandler witness_;
};

}  // namespace tether::campaign
