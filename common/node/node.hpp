#pragma once

#include <cstddef>
#include <memory>
#include <utility>
#include <vector>

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

/// The nodes of one kind of all vehicles of a fleet, as one node.
template <class One>
class NodeGroup final : public Node {
 public:
  void add(std::unique_ptr<One> node) { nodes_.push_back(std::move(node)); }

  std::size_t size() const { return nodes_.size(); }
  One& operator[](std::size_t i) { return *nodes_[i]; }
  const One& operator[](std::size_t i) const { return *nodes_[i]; }

  bool wind_down() override {
    bool done = true;
    for (const auto& node : nodes_) done = node->wind_down() && done;
    return done;
  }
  void finish() override {
    for (const auto& node : nodes_) node->finish();
  }

 private:
  std::vector<std::unique_ptr<One>> nodes_;
};

/// One for each of `members` (fleet_members()), made of it and `more`.
template <class One, class Settings, class... More>
std::unique_ptr<NodeGroup<One>> group_of(const std::vector<Settings>& members, More&... more) {
  auto group = std::make_unique<NodeGroup<One>>();
  for (const Settings& member : members) group->add(std::make_unique<One>(member, more...));
  return group;
}

}  // namespace tether
