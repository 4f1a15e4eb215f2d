#include "tools/view/server/access.hpp"

#include <fmt/format.h>
#include <sys/random.h>

#include <algorithm>
#include <array>
#include <cctype>

#include "common/base/errors.hpp"
#include "common/base/text.hpp"

namespace tether {
namespace {

/// Takes equally long wherever they differ, so that time does not tell how much was right.
bool equal_secrets(std::string_view a, std::string_view b) {
  if (a.size() != b.size()) return false;
  unsigned difference = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    difference |= static_cast<unsigned char>(a[i]) ^ static_cast<unsigned char>(b[i]);
  }
  return difference == 0;
}

/// Whether one of `text`'s parts between `separator`s is name=secret.
bool holds(std::string_view text, char separator, std::string_view name, std::string_view secret) {
  bool found = false;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find(separator), text.size());
    const std::string_view part = trimmed(text.substr(0, end));
    const std::size_t equals = part.find('=');
    if (equals != std::string_view::npos && part.substr(0, equals) == name) {
      found = found || equal_secrets(part.substr(equals + 1), secret);
    }
    text.remove_prefix(std::min(end + 1, text.size()));
  }
  return found;
}

std::string lower(std::string_view text) {
  std::string all(text);
  for (char& c : all) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return all;
}

bool is_loopback_host(std::string_view host, std::uint16_t port) {
  const std::string wanted_port = port == 80 ? "" : fmt::format(":{}", port);
  for (const char* const name : {"127.0.0.1", "localhost", "[::1]"}) {
    if (lower(host) == name + wanted_port || lower(host) == fmt::format("{}:{}", name, port)) {
      return true;
    }
  }
  // 127.0.0.2 and so on, if the server listens there.
  const std::size_t colon = host.find(':');
  return is_loopback(host.substr(0, colon)) &&
         host.substr(std::min(colon, host.size())) == wanted_port;
}

}  // namespace

std::string_view path_of_target(std::string_view target) {
  return target.substr(0, target.find('?'));
}

bool is_origin(std::string_view text) {
  constexpr std::string_view kLetters = "abcdefghijklmnopqrstuvwxyz", kDigits = "0123456789";
  const auto consists_of = [&](std::string_view part, std::string_view more) {
    return !part.empty() && std::all_of(part.begin(), part.end(), [&](char c) {
      return kLetters.find(c) != std::string_view::npos ||
             kDigits.find(c) != std::string_view::npos || more.find(c) != std::string_view::npos;
    });
  };
  constexpr std::string_view kBetween = "://";
  const std::size_t end = text.find(kBetween);
  return end != std::string_view::npos && consists_of(text.substr(0, end), "+-.") &&
         consists_of(text.substr(end + kBetween.size()), "-._:[]");
}

std::string token_cookie(std::uint16_t port) { return fmt::format("tether_view_{}", port); }

bool has_token_in_target(const AccessRules& rules, std::string_view target) {
  const std::size_t question = target.find('?');
  return !rules.token.empty() && question != std::string_view::npos &&
         holds(target.substr(question + 1), '&', "token", rules.token);
}

bool is_loopback(std::string_view address) {
  if (address == "::1") return true;
  if (!address.starts_with("127.")) return false;
  return std::count(address.begin(), address.end(), '.') == 3 &&
         address.find_first_not_of("0123456789.") == std::string_view::npos;
}

std::string why_refused(const AccessRules& rules, const AccessRequest& request) {
  if (request.host.empty()) return "the request has no Host";
  constexpr auto kHostCharacters =
      "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789.-:[]_";
  if (request.host.find_first_not_of(kHostCharacters) != std::string_view::npos) {
    return "the request's Host is none";
  }
  if (rules.token.empty() && !is_loopback_host(request.host, rules.port)) {
    return fmt::format("Host is {}, which is not this server: use http://127.0.0.1:{}",
                       printable(request.host, 100), rules.port);
  }
  const bool is_own = lower(request.origin) == "http://" + lower(request.host);
  const auto& others = rules.origins;
  if (!request.origin.empty() && !is_own &&
      std::find(others.begin(), others.end(), request.origin) == others.end()) {
    return fmt::format("the request comes from {}: allow it by --allow-origin",
                       printable(request.origin, 100));
  }
  if (rules.token.empty() || has_token_in_target(rules, request.target) ||
      holds(request.cookie, ';', token_cookie(rules.port), rules.token)) {
    return "";
  }
  return "the token is missing or wrong: open the address that was printed at the start";
}

void check_token(const std::string& token) {
  constexpr std::size_t kShortest = 16, kLongest = 128;
  constexpr auto kAllowed = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._-";
  if (token.size() >= kShortest && token.size() <= kLongest &&
      token.find_first_not_of(kAllowed) == std::string::npos) {
    return;
  }
  throw UsageError(fmt::format(
      "--token: has to be {} to {} letters, digits, '.', '_' or '-', and hard to guess: such as {}",
      kShortest, kLongest, random_token()));
}

std::string random_token() {
  std::array<unsigned char, 16> bytes{};
  check_system_call("asking the system for random bytes",
                    static_cast<int>(getrandom(bytes.data(), bytes.size(), 0)));
  std::string token;
  for (const unsigned char byte : bytes) token += fmt::format("{:02x}", byte);
  return token;
}

}  // namespace tether
