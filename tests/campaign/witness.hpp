#pragma once

#include <set>
#include <utility>

#include "common/node/bus.hpp"
#include "tests/campaign/record.hpp"

namespace tether::campaign {

/// Judges by themselves the messages that reach the bridge, without the bridge's knowledge of what
/// came before: what it calls of no effect must have none, what it lets pass the bridge may refuse
/// all the same.
class Witness {
 public:
  explicit Witness(Record& record) : record_(record) {}

  void on_message(Instant now, const Message& message);

 private:
  void on_twist(Instant now, const Message& message);
  void on_plan(Instant now, const Message& message);
  void on_request(Instant now, const Message& message);

  Record& record_;
  std::set<std::pair<std::int64_t, std::int64_t>> used_requests_;
};

}  // namespace tether::campaign
