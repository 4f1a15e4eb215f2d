#pragma once

#include <cstddef>
#include <memory>
#include <utility>
#include <vector>

#include "common/loop/node.hpp"

namespace tether {

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
