#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace tether {

/// Who may talk to the server. Any page that a browser shows can send requests to 127.0.0.1, and
/// by a DNS name that is made to mean 127.0.0.1 even as if it came from there (DNS rebinding). So:
///
/// - without a token, a request's Host must name this machine's loopback, with the port;
/// - a request that says from which page it comes (Origin: browsers do, for WebSockets always) must
///   come from this server's own page, or from one of `origins`;
/// - with a token, each request must have it: in the address, as `token=`, or in a cookie, which
///   the server sets when it has seen it in the address.
struct AccessRules {
  std::uint16_t port = 0;
  std::string token;                 ///< empty: none is wanted
  std::vector<std::string> origins;  ///< "https://app.foxglove.dev"
};

/// Parts of a request that decide on access; empty is missing.
struct AccessRequest {
  std::string_view target;  ///< "/api/run.json?token=…"
  std::string_view host;
  std::string_view origin;
  std::string_view cookie;
};

/// Empty if it may pass; else why not, for people.
std::string why_refused(const AccessRules& rules, const AccessRequest& request);

/// Whether that is an origin as browsers say it: "https://app.foxglove.dev", in lower case, with
/// nothing after the host but a port.
bool is_origin(std::string_view text);

/// The name of the cookie that holds the token. Cookies do not tell ports apart: names do.
std::string token_cookie(std::uint16_t port);

/// Whether the token is in the address itself.
bool has_token_in_target(const AccessRules& rules, std::string_view target);

/// Path of "/a/b?c=d": "/a/b".
std::string_view path_of_target(std::string_view target);

/// Whether an address to listen on is of this machine alone: 127.x.x.x or ::1.
bool is_loopback(std::string_view address);

/// Throws UsageError for a token, as given by --token, that is easy to guess or needs quoting.
void check_token(const std::string& token);

/// 128 random bits from the system, in hexadecimal digits.
std::string random_token();

}  // namespace tether
