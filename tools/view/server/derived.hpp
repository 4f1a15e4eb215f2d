#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "tools/messages/message_printer.hpp"

namespace tether {

/// Channels that the server makes of what it hears: a scene, transforms.
class DerivedChannels {
 public:
  struct Description {
    std::string topic;
    std::string schema_name;
    std::string schema;  ///< a JSON Schema
  };
  /// Called with the number of the channel in channels() and its message in JSON.
  using Emit = std::function<void(std::size_t channel, std::string json)>;

  virtual ~DerivedChannels() = default;
  DerivedChannels(const DerivedChannels&) = delete;
  DerivedChannels& operator=(const DerivedChannels&) = delete;

  virtual const std::vector<Description>& channels() const = 0;
  /// Whether a message of this LCM channel and type is of any use here.
  virtual bool reads(std::string_view topic, const MessageType& type) const = 0;
  virtual void on_message(std::string_view topic, const MessageContent& message,
                          std::uint64_t time_ns, const Emit& emit) = 0;

 protected:
  DerivedChannels() = default;
};

}  // namespace tether
