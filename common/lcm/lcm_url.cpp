#include "common/lcm/lcm_url.hpp"

#include <arpa/inet.h>
#include <fmt/format.h>

#include <algorithm>
#include <cstdint>

#include "common/base/errors.hpp"
#include "common/base/pattern.hpp"
#include "common/base/text.hpp"

namespace tether {
namespace {

constexpr char kAllowed[] =
    "allowed: udpm://GROUP:PORT[?ttl=N&recv_buf_size=N] with GROUP in 224.0.0.0-239.255.255.255, "
    "such as udpm://239.255.76.67:7667?ttl=0, or tcpq://HOST:PORT";

[[noreturn]] void refuse(const std::string& url, const std::string& why) {
  throw UsageError(fmt::format("LCM URL \"{}\": {} ({})", url, why, kAllowed));
}

void check_group(const std::string& url, const std::string& host) {
  in_addr address{};
  if (inet_pton(AF_INET, host.c_str(), &address) != 1) {
    refuse(url, fmt::format("\"{}\" is not an IPv4 address", host));
  }
  if (!IN_MULTICAST(ntohl(address.s_addr))) {
    refuse(url, fmt::format("{} is not a multicast group", host));
  }
}

// Returns whether recv_buf_size is among the options.
bool check_options(const std::string& url, std::string options) {
  bool has_buffer = false;
  for (bool more = !options.empty(); more;) {
    const auto end = options.find('&');
    const std::string option = options.substr(0, end);
    more = end != std::string::npos;
    if (more) options.erase(0, end + 1);
    const auto equals = option.find('=');
    const std::string key = option.substr(0, equals);
    const std::int64_t value =
        equals == std::string::npos
            ? -1
            : to_number<std::int64_t>(option.substr(equals + 1)).value_or(-1);
    const bool is_ttl = key == "ttl" && value >= 0 && value <= 255;
    const bool is_buffer = key == "recv_buf_size" && value > 0 && value <= INT32_MAX;
    if (!is_ttl && !is_buffer) refuse(url, fmt::format("bad option \"{}\"", option));
    has_buffer = has_buffer || is_buffer;
  }
  return has_buffer;
}

}  // namespace

std::string checked_lcm_url(const std::string& url) {
  static const Pattern kPattern("(udpm|tcpq)://([^:/?]*)(?::([^?/]*))?(?:\\?(.*))?");
  const auto part = kPattern.groups(url);
  if (!part) refuse(url, "not an LCM URL that Tether can use");
  const std::string &scheme = part->at(0), &host = part->at(1), &port = part->at(2),
                    &options = part->at(3);
  if (host.empty()) refuse(url, scheme == "udpm" ? "no multicast group" : "no host");
  if (port.empty()) refuse(url, "no port");
  if (const auto number = to_number<std::int64_t>(port).value_or(-1);
      number < 1 || number > 65535) {
    refuse(url, fmt::format("port \"{}\" is not a number from 1 to 65535", port));
  }
  if (scheme == "tcpq") {
    if (!options.empty()) refuse(url, "tcpq has no options");
    return url;
  }
  check_group(url, host);
  if (check_options(url, options)) return url;
  const bool has_mark = url.find('?') != std::string::npos;
  return url + (options.empty() ? (has_mark ? "" : "?") : "&") + "recv_buf_size=2097152";
}

std::string multicast_group(const std::string& url) {
  if (!url.starts_with("udpm://")) return "";
  return url.substr(7, url.find(':', 7) - 7);
}

std::uint16_t lcm_port(const std::string& url) {
  return static_cast<std::uint16_t>(std::stoul(url.substr(url.rfind(':') + 1)));
}

std::string with_next_port(const std::string& url) {
  const auto port = url.rfind(':') + 1;
  const auto end = std::min(url.find_first_of("?/", port), url.size());
  const int next = lcm_port(url) == 65535 ? 1024 : lcm_port(url) + 1;
  return fmt::format("{}{}{}", url.substr(0, port), next, url.substr(end));
}

std::int64_t lcm_option(const std::string& url, const std::string& key) {
  const auto found = url.find(key + "=");
  return found == std::string::npos ? 0 : std::stoll(url.substr(found + key.size() + 1));
}

}  // namespace tether
