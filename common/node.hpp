#pragma once

namespace tether {

/// A part of the loop. It schedules and subscribes everything in its constructor and then lives
/// from the event loop's calls.
class Node {
 public:
  virtual ~Node() = default;

  /// Publishes final reports; called once, when the run has ended.
  virtual void finish() = 0;

 protected:
  Node() = default;
  Node(const Node&) = delete;
  Node& operator=(const Node&) = delete;
};

}  // namespace tether
