#pragma once

#include <chrono>
#include <string>
#include <utility>
#include <vector>

#include "can_bridge/bus/can_port.hpp"
#include "common/node/event_loop.hpp"

namespace tether::bench {

/// Sums up the wall time of one kind of work.
class Stopwatch {
 public:
  template <class Work>
  void time(const Work& work) {
    const auto start = std::chrono::steady_clock::now();
    work();
    total_ += std::chrono::steady_clock::now() - start;
    ++calls_;
  }
  double seconds() const { return std::chrono::duration<double>(total_).count(); }
  std::int64_t calls() const { return calls_; }

 private:
  std::chrono::steady_clock::duration total_{0};
  std::int64_t calls_ = 0;
};

/// Passes everything on to another loop, and times the tasks of one period.
class TimedLoop final : public EventLoop {
 public:
  TimedLoop(EventLoop& inner, Duration period, Stopwatch& watch)
      : inner_(inner), period_(period), watch_(watch) {}

  Instant now() const override { return inner_.now(); }
  double rate() const override { return inner_.rate(); }
  void at(Instant when, Priority priority, Task task) override {
    inner_.at(when, priority, std::move(task));
  }
  void every(Instant first, Duration period, Priority priority, Task task) override {
    if (period == period_) {
      task = [this, task = std::move(task)](Instant t) { watch_.time([&] { task(t); }); };
    }
    inner_.every(first, period, priority, std::move(task));
  }
  void add_fd(int fd, Task task) override { inner_.add_fd(fd, std::move(task)); }
  void remove_fd(int fd) override { inner_.remove_fd(fd); }
  void stop() override { inner_.stop(); }
  std::uint64_t slips() const override { return inner_.slips(); }

 private:
  EventLoop& inner_;
  Duration period_;
  Stopwatch& watch_;
};

/// Passes everything on to another port, and times what is done with the frames that come in.
class TimedPort final : public CanPort {
 public:
  TimedPort(CanPort& inner, Stopwatch& watch) : inner_(inner), watch_(watch) {}

  bool send(const CanFrame& frame) override { return inner_.send(frame); }
  void on_frame(std::vector<CanFilter> filters, FrameHandler handler) override {
    inner_.on_frame(std::move(filters), [this, handler = std::move(handler)](const CanFrame& f) {
      watch_.time([&] { handler(f); });
    });
  }
  void on_state(StateHandler handler) override { inner_.on_state(std::move(handler)); }
  CanState state() const override { return inner_.state(); }
  bool restart(std::string& why) override { return inner_.restart(why); }
  void list(CounterList& out) const override { inner_.list(out); }

 private:
  CanPort& inner_;
  Stopwatch& watch_;
};

}  // namespace tether::bench
