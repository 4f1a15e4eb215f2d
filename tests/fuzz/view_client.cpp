#include <cstdint>
#include <memory>
#include <string>
#include <tether/pose_t.hpp>
#include <vector>

#include "common/node/message_io.hpp"
#include "tests/fuzz/fuzz.hpp"
#include "tools/view/server/access.hpp"
#include "tools/view/server/hub.hpp"
#include "tools/view/sources/network_parameters.hpp"
#include "tools/view/sources/network_view.hpp"

namespace tether::fuzzing {
namespace {

/// The next line of the input.
std::string_view next_line(std::string_view& rest) {
  const std::size_t end = std::min(rest.find('\n'), rest.size());
  const std::string_view line = rest.substr(0, end);
  rest.remove_prefix(std::min(end + 1, rest.size()));
  return line;
}

std::vector<std::uint8_t> pose() {
  const pose_t message{};
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(message.getEncodedSize()));
  message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  return bytes;
}

/// A client's request may be refused, but only by UsageError.
void carry_out(const ViewRequest& request, const NetworkParameters& network) {
  if (const auto* publish = std::get_if<ViewRequest::Publish>(&request.what)) {
    must(publish->topic == "CAN/REQUEST", "a client publishes only where it may");
    takes([&] { parse_operator_request(publish->json); });
    return;
  }
  std::vector<std::string> settings;
  const auto& parameters = std::get<std::vector<Parameter>>(request.what);
  if (!takes([&] { settings = network.settings(parameters); })) return;
  for (const std::string& setting : settings) {
    must(!file_of_setting(setting), "no page names a file");
    must(setting.find('\n') == std::string::npos, "a setting is one line");
  }
  takes([&] { change_channel({}, settings); });
}

}  // namespace

/// A client says one line after the other, binary those that begin with the byte 1: each is taken
/// or complained about, and what is kept for the client stays within its bounds.
void try_input(std::span<const std::uint8_t> input) {
  static const NetworkParameters kNetwork;
  static const std::vector<std::uint8_t> kPose = pose();
  std::vector<ViewRequest> asked;
  Hub::Options options;
  options.publishable = {"CAN/REQUEST"};
  Hub hub(options, [&](ViewRequest request) { asked.push_back(std::move(request)); });
  hub.update(kNetwork.values());
  hub.hear("AGV/POSE", kPose, 1);
  const ClientId client = hub.connect();
  const std::string text = text_of(input);
  for (std::string_view rest = text; !rest.empty();) {
    const std::string_view line = next_line(rest);
    if (line.starts_with('\x01')) {
      hub.on_binary(client, {reinterpret_cast<const std::uint8_t*>(line.data()), line.size()});
    } else {
      hub.on_text(client, line);
    }
    hub.hear("AGV/POSE", kPose, 2);
    const Session& session = hub.session(client);
    must(session.channels.size() <= session.limits().subscriptions, "subscriptions are bounded");
    must(session.publications.size() <= session.limits().publications, "publications are bounded");
    why_refused({8765, "0123456789abcdef", {}}, {line, line, line, line});
    must(!why_refused({8765, "", {}}, {"/", "evil.example", line, ""}).empty(), "no other host");
  }
  for (const ViewRequest& request : asked) carry_out(request, kNetwork);
  while (hub.session(client).next()) continue;
  hub.disconnect(client);
}

}  // namespace tether::fuzzing
