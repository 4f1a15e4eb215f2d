#include "common/node/counter_reporter.hpp"

#include <tether/counters_t.hpp>
#include <utility>

#include "common/node/message_io.hpp"

namespace tether {

CounterReporter::CounterReporter(EventLoop& loop, Bus& bus, std::string node, std::string channel,
                                 Duration period, std::function<void(CounterList&)> list)
    : loop_(loop),
      bus_(bus),
      node_(std::move(node)),
      channel_(std::move(channel)),
      list_(std::move(list)) {
  loop_.every(kStart + period, period, Priority::observer, [this](Instant) { publish_now(); });
}

void CounterReporter::publish_now() {
  CounterList counters;
  list_(counters);
  counters.emplace_back("loop.slips", static_cast<std::int64_t>(loop_.slips()));
  CounterList network;
  bus_.list_counters(network);
  for (const auto& [name, count] : network) {
    const bool is_told = name == "datagrams_dropped" || name == "refused";
    if (is_told && count > 0) counters.emplace_back("network." + name, count);
  }

  counters_t message{};
  message.utime = to_utime(loop_.now());
  message.seq = seq_++;
  message.node = node_;
  message.count = static_cast<std::int32_t>(counters.size());
  for (const auto& [name, value] : counters) {
    message.name.push_back(name);
    message.value.push_back(value);
  }
  publish(bus_, channel_, message);
}

}  // namespace tether
