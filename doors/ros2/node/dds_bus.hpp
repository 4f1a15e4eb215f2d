#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/time.hpp"
#include "common/ros2/ros2_messages.hpp"

namespace tether {

/// A participant in ROS 2's network, as its middlewares speak it: DDS by Cyclone, with topics and
/// types named as ROS 2 names them ("/odom" is rt/odom). Messages are bytes of CDR.
///
/// Everything is offered reliable, volatile and with a depth of 100, which matches every
/// subscriber's request except for durability; topics that end in "tf_static" are transient local,
/// with a depth of 1. Subscriptions are best effort, which matches every publisher.
///
/// A reliable write may block while a subscriber is slow. So publish() only queues messages, and a
/// thread writes them. Of more than kQueue messages the oldest is dropped and counted.
class DdsBus {
 public:
  struct Settings {
    int domain = 0;
    bool subnet = false;  ///< false: finds nodes of this host only
  };
  struct Received {
    std::size_t subscription;     ///< the number that subscribe() returned
    std::uint64_t publisher = 0;  ///< tells publishers apart; not 0
    std::string cdr;
  };
  static constexpr std::size_t kQueue = 1000;
  static constexpr std::size_t kInbox = 100;

  /// Throws std::runtime_error if DDS does not start.
  explicit DdsBus(const Settings& settings);
  ~DdsBus();
  DdsBus(const DdsBus&) = delete;
  DdsBus& operator=(const DdsBus&) = delete;

  /// Offers a topic, so that subscribers match before the first message. `type` is one of those of
  /// common/ros2/ros2_messages.hpp.
  void advertise(const std::string& topic, std::string_view type);
  /// Queues a message of an advertised topic.
  void publish(RosMessage message);
  std::size_t subscribe(const std::string& topic, std::string_view type);

  /// Removes and returns the messages that have arrived; of more than kInbox the newest.
  std::vector<Received> take();
  /// Waits until something has arrived; false after `timeout`.
  bool wait(Duration timeout);
  /// Readable when something has arrived or is to be noticed. take() resets it.
  int fd() const;

  /// Name of a publisher that is matched: its GUID, in hexadecimal digits.
  std::string name(const Received& received) const;
  /// Lines about peers whose quality of service does not match, each once.
  std::vector<std::string> notices();
  /// Messages that were dropped because the queue was full, or that DDS did not take.
  std::int64_t dropped() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tether
