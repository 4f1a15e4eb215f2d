#pragma once

#include <memory>
#include <string>

#include "common/bus/bus.hpp"
#include "common/loop/event_loop.hpp"

namespace tether {

/// The LCM network of this URL: a UdpmBus for udpm://, a LcmBus for tcpq://. Throws as they do.
/// `loop` must outlive the bus. Messages that `filter` refuses are counted and not delivered. It
/// has no effect over tcpq, because LCM does not tell who sent a message.
std::unique_ptr<Bus> open_bus(const std::string& url, EventLoop& loop, Bus::Filter filter = {});

}  // namespace tether
