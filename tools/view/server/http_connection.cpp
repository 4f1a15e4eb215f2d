#include <fmt/format.h>

#include <algorithm>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket/rfc6455.hpp>
#include <chrono>
#include <map>
#include <optional>

#include "tools/view/server/connections.hpp"
#include "tools/view/server/server_message.hpp"

namespace tether {
namespace {

namespace beast = boost::beast;
namespace http = beast::http;
using Error = boost::system::error_code;
using Response = http::response<http::string_body>;

constexpr std::uint32_t kMostHeaderBytes = 8 * 1024;
/// For a request to come in whole, and for its answer to be taken; of a client that may pass, …
constexpr auto kPatience = std::chrono::seconds{10};
/// … and of anybody else.
constexpr auto kPatienceWithAnybody = std::chrono::milliseconds{1500};

std::string_view text(beast::string_view s) { return {s.data(), s.size()}; }

/// One connection, one request after the other.
class HttpConnection : public std::enable_shared_from_this<HttpConnection> {
 public:
  HttpConnection(boost::asio::ip::tcp::socket socket, ViewServices& services)
      : services_(services), stream_(std::move(socket)) {}
  ~HttpConnection() {
    if (waiting_) services_.waiting.leave(waiting_);
  }
  HttpConnection(const HttpConnection&) = delete;
  HttpConnection& operator=(const HttpConnection&) = delete;

  void begin() {
    Error error;
    const auto from = stream_.socket().remote_endpoint(error).address();
    if (error) return;  // it is gone already
    waiting_ =
        std::make_shared<WaitingConnection>(WaitingConnection{from, [weak = weak_from_this()] {
                                                                if (const auto self = weak.lock())
                                                                  self->cut_off();
                                                              }});
    if (const auto evicted = services_.waiting.enter(waiting_)) {
      ++services_.refused;
      evicted->close();
    }
    read();
  }

 private:
  void read() {
    parser_.emplace();
    parser_->header_limit(kMostHeaderBytes);
    parser_->body_limit(0);
    stream_.expires_after(patience());
    http::async_read(
        stream_, received_, *parser_, [self = shared_from_this()](const Error& error, std::size_t) {
          if (!error) return self->on_request();
          if (error == http::error::end_of_stream) return self->close();
          if (error.category() == http::make_error_code(http::error::bad_method).category()) {
            self->answer(http::status::bad_request, "this is no request of HTTP\n");
          }
        });
  }

  std::chrono::milliseconds patience() const {
    return counted_ ? std::chrono::milliseconds{kPatience} : kPatienceWithAnybody;
  }

  const UpgradeRequest& request() const { return parser_->get(); }

  void on_request() {
    const AccessRequest asked{text(request().target()), text(request()[http::field::host]),
                              text(request()[http::field::origin]),
                              text(request()[http::field::cookie])};
    const std::string refused = why_refused(services_.access, asked);
    if (!refused.empty()) {
      ++services_.refused;
      return answer(http::status::forbidden, refused + "\n");
    }
    if (!counted_) {
      if (services_.connections >= services_.most_connections) {
        ++services_.refused;
        return answer(http::status::service_unavailable, "there are as many clients as may be\n");
      }
      services_.waiting.leave(waiting_);
      waiting_.reset();
      counted_ = std::make_shared<CountedConnection>(services_);
    }
    const bool is_post = services_.site && request().method() == http::verb::post;
    if (beast::websocket::is_upgrade(request()) && !services_.site) return upgrade();
    if (request().method() != http::verb::get && request().method() != http::verb::head &&
        !is_post) {
      return answer(http::status::method_not_allowed, "GET and HEAD are what there is\n");
    }
    if (services_.site) return serve(services_.site(is_post, path_of_target(asked.target)));
    serve(path_of_target(asked.target));
  }

  void serve(WebAnswer of_site) {
    policy_ = std::move(of_site.policy);
    answer(static_cast<http::status>(of_site.status), std::move(of_site.body), of_site.type);
  }

  void serve(std::string_view path) {
    if (path == "/api/run.json") {
      return answer(http::status::ok, services_.run_json, "application/json");
    }
    if (path == "/api/status.json") {
      return answer(http::status::ok, services_.status_json(), "application/json");
    }
    if (auto file = services_.page.find(path)) {
      return answer(http::status::ok, std::move(file->bytes), file->type);
    }
    answer(http::status::not_found, "there is no such file\n");
  }

  void upgrade() {
    if (chosen_protocol(request()).empty()) {
      return answer(http::status::bad_request,
                    fmt::format("the WebSocket has to offer the protocol {} or {}\n",
                                kFoxgloveProtocol, kFoxgloveSdkProtocol));
    }
    stream_.expires_never();
    serve_websocket(stream_.release_socket(), request(), services_, counted_);
  }

  void answer(http::status status, std::string body,
              const std::string& type = "text/plain; charset=utf-8") {
    response_.emplace(status, 11);
    Response& r = *response_;
    r.set(http::field::content_type, type);
    r.set("Content-Security-Policy", policy_.empty() ? policy_of_page(status) : policy_);
    r.set("X-Content-Type-Options", "nosniff");
    r.set("Referrer-Policy", "no-referrer");
    r.set("Cross-Origin-Resource-Policy", "same-origin");
    r.set(http::field::cache_control, "no-cache");
    if (status == http::status::method_not_allowed) r.set(http::field::allow, "GET, HEAD");
    if (status == http::status::ok &&
        has_token_in_target(services_.access, text(request().target()))) {
      r.set(http::field::set_cookie,
            fmt::format("{}={}; Path=/; HttpOnly; SameSite=Strict",
                        token_cookie(services_.access.port), services_.access.token));
    }
    r.content_length(body.size());
    if (request().method() != http::verb::head) r.body() = std::move(body);
    r.keep_alive(status == http::status::ok && request().keep_alive());
    send();
  }

  /// Nothing but what comes from here; the WebSocket by its name, for older browsers.
  std::string policy_of_page(http::status status) const {
    return fmt::format(
        "default-src 'self'; connect-src 'self' ws://{}; img-src 'self' data: blob:; "
        "object-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
        status == http::status::ok ? text(request()[http::field::host]) : "");
  }

  void send() {
    stream_.expires_after(patience());
    http::async_write(stream_, *response_,
                      [self = shared_from_this()](const Error& error, std::size_t) {
                        if (error) return;
                        if (!self->response_->keep_alive()) return self->close();
                        self->read();
                      });
  }

  void close() {
    Error ignored;
    stream_.socket().shutdown(boost::asio::ip::tcp::socket::shutdown_send, ignored);
  }

  void cut_off() {
    Error ignored;
    stream_.socket().close(ignored);
  }

  ViewServices& services_;
  std::shared_ptr<WaitingConnection> waiting_;  ///< before a request may pass
  std::shared_ptr<CountedConnection> counted_;  ///< then
  beast::tcp_stream stream_;
  beast::flat_buffer received_{std::size_t{2} * kMostHeaderBytes};
  std::optional<http::request_parser<http::empty_body>> parser_;
  std::optional<Response> response_;
  std::string policy_;  ///< policy of a site; empty: policy_of_page()
};

}  // namespace

void serve_http(boost::asio::ip::tcp::socket socket, ViewServices& services) {
  std::make_shared<HttpConnection>(std::move(socket), services)->begin();
}

std::shared_ptr<WaitingConnection> WaitingRoom::enter(
    std::shared_ptr<WaitingConnection> connection) {
  std::map<boost::asio::ip::address, std::size_t> counts;
  for (const auto& one : waiting_) ++counts[one->from];
  std::optional<boost::asio::ip::address> from;
  if (counts[connection->from] >= kMostOfOneAddress) {
    from = connection->from;
  } else if (waiting_.size() >= kMost) {
    const auto most = std::max_element(counts.begin(), counts.end(),
                                       [](auto& a, auto& b) { return a.second < b.second; });
    from = most->first;
  }
  waiting_.push_back(std::move(connection));
  if (!from) return nullptr;
  const auto oldest = std::find_if(waiting_.begin(), waiting_.end(),
                                   [&](const auto& one) { return one->from == *from; });
  std::shared_ptr<WaitingConnection> evicted = std::move(*oldest);
  waiting_.erase(oldest);
  return evicted;
}

void WaitingRoom::leave(const std::shared_ptr<WaitingConnection>& connection) {
  waiting_.remove(connection);
}

}  // namespace tether
