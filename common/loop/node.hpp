#pragma once

namespace tether {

/// A part of the control loop. It schedules and subscribes everything in its constructor and then
/// lives from the event loop's calls.
class Node {
 public:
  virtual ~Node() = default;

  /// The run is about to end: does what takes time to end in good order, such as bringing a vehicle
  /// to a standstill. In real time it is called again and again, while the loop goes on, until it
  /// says true (done) or kWindDownLimit (node_main.hpp) is over. Not called in virtual time, whose
  /// run ends all at once.
  virtual bool wind_down() { return true; }

  /// Publishes final reports; called once, when the run has ended.
  virtual void finish() = 0;

 protected:
  Node() = default;
  Node(const Node&) = delete;
  Node& operator=(const Node&) = delete;
};

}  // namespace tether
