#pragma once

#include <functional>
#include <string>
#include <string_view>

namespace tether {

/// Answer to an HTTP request.
struct WebAnswer {
  unsigned status = 200;
  std::string body = {};
  std::string type = "text/plain; charset=utf-8";
  std::string policy = "default-src 'none'";  ///< Content-Security-Policy
};

/// Answers the requests that may pass: by their path, "/a/b" as it was sent; POST (without a body),
/// or GET and HEAD. It is called in the server's thread, and so does not wait for anything.
using WebSite = std::function<WebAnswer(bool is_post, std::string_view path)>;

}  // namespace tether
