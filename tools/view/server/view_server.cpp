#include "tools/view/server/view_server.hpp"

#include <fmt/format.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <mutex>
#include <nlohmann/json.hpp>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <thread>
#include <utility>
#include <variant>
#include <vector>

#include "common/base/errors.hpp"
#include "common/base/text.hpp"
#include "tools/base/json.hpp"
#include "tools/view/server/connections.hpp"
#include "tools/view/server/hub.hpp"

namespace tether {

/// Messages of the program to the server's thread; filled by the one and emptied by the other,
/// neither of which waits for more than a copy. Bounded: what does not fit is dropped and counted.
class ViewInbox {
 public:
  struct Heard {
    std::size_t topic_begin = 0, topic_bytes = 0, data_bytes = 0;
    std::uint64_t time_ns = 0;
  };
  struct Json {
    DerivedChannels::Description channel;
    std::uint64_t time_ns = 0;
    std::string json;
  };
  struct Status {
    StatusLevel level;
    std::string text;
  };
  struct Time {
    std::uint64_t time_ns = 0;
  };
  using Item = std::variant<Heard, Json, std::vector<Parameter>, ViewAnswer, Status, Time>;

  struct Batch {
    std::vector<Item> items;
    std::vector<std::uint8_t> bytes;  ///< bytes of the received message
  };
  static constexpr std::size_t kMostBytes = std::size_t{16} << 20;
  static constexpr std::size_t kMostItems = 200'000;

  /// True if it was empty.
  bool hear(std::string_view topic, std::span<const std::uint8_t> data, std::uint64_t time_ns) {
    const std::lock_guard lock(mutex_);
    if (waiting_.items.size() >= kMostItems ||
        waiting_.bytes.size() + topic.size() + data.size() > kMostBytes) {
      ++dropped_;
      return false;
    }
    const bool was_empty = waiting_.items.empty();
    waiting_.items.emplace_back(Heard{waiting_.bytes.size(), topic.size(), data.size(), time_ns});
    waiting_.bytes.insert(waiting_.bytes.end(), topic.begin(), topic.end());
    waiting_.bytes.insert(waiting_.bytes.end(), data.begin(), data.end());
    return was_empty;
  }

  /// The same for what is rare.
  bool put(Item item) {
    const std::lock_guard lock(mutex_);
    if (waiting_.items.size() >= 2 * kMostItems) {
      ++dropped_;
      return false;
    }
    const bool was_empty = waiting_.items.empty();
    waiting_.items.push_back(std::move(item));
    return was_empty;
  }

  /// Exchanges what waits for `batch`, whose memory is used again.
  void take(Batch& batch) {
    batch.items.clear();
    batch.bytes.clear();
    const std::lock_guard lock(mutex_);
    std::swap(batch, waiting_);
  }

  bool empty() const {
    const std::lock_guard lock(mutex_);
    return waiting_.items.empty();
  }
  std::int64_t dropped() const {
    const std::lock_guard lock(mutex_);
    return dropped_;
  }

 private:
  mutable std::mutex mutex_;
  Batch waiting_;
  std::int64_t dropped_ = 0;
};

/// Clients' requests on their way to the program's loop, which watches fd().
class RequestBox {
 public:
  static constexpr std::size_t kMost = 1000;

  RequestBox()
      : fd_(check_system_call("making an eventfd", eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK))) {}
  ~RequestBox() { close(fd_); }
  RequestBox(const RequestBox&) = delete;
  RequestBox& operator=(const RequestBox&) = delete;

  int fd() const { return fd_; }

  /// False if there is no room.
  bool put(ViewRequest request) {
    const std::lock_guard lock(mutex_);
    if (waiting_.size() >= kMost) return false;
    waiting_.push_back(std::move(request));
    eventfd_write(fd_, 1);
    return true;
  }

  std::vector<ViewRequest> take() {
    const std::lock_guard lock(mutex_);
    eventfd_t count = 0;
    eventfd_read(fd_, &count);
    return std::exchange(waiting_, {});
  }

 private:
  std::mutex mutex_;
  int fd_;
  std::vector<ViewRequest> waiting_;
};

namespace {

namespace asio = boost::asio;
using tcp = asio::ip::tcp;
using Error = boost::system::error_code;

/// Messages received within this time are sent together.
constexpr auto kGather = std::chrono::milliseconds{10};
constexpr auto kAcceptAgain = std::chrono::milliseconds{100};
constexpr int kPortsToTry = 100;

asio::ip::address listening_address(const std::string& text) {
  Error error;
  auto address = asio::ip::make_address(text, error);
  if (!error) return address;
  throw UsageError(fmt::format(
      "address \"{}\": has to be an IP address in digits: 127.0.0.1 or ::1 (of this host alone), "
      "0.0.0.0 or :: (all of its addresses), or one that it has",
      printable(text, kLongestNameShown)));
}

/// The error that it ended with; none if it listens.
Error try_to_listen(tcp::acceptor& acceptor, const tcp::endpoint& endpoint) {
  Error error;
  acceptor.open(endpoint.protocol(), error);
  if (!error) acceptor.set_option(tcp::acceptor::reuse_address(true), error);
  if (!error) acceptor.bind(endpoint, error);
  if (!error) acceptor.listen(asio::socket_base::max_listen_connections, error);
  Error ignored;
  if (error) acceptor.close(ignored);
  return error;
}

tcp::acceptor listen(asio::io_context& io, const std::string& address, std::uint16_t port) {
  tcp::acceptor acceptor(io);
  const tcp::endpoint wanted(listening_address(address), port);
  const Error error = try_to_listen(acceptor, wanted);
  if (!error) return acceptor;
  std::string advice;
  if (error == asio::error::address_in_use) {
    for (int next = port + 1; next <= std::min(port + kPortsToTry, 65535); ++next) {
      tcp::acceptor other(io);
      if (try_to_listen(other, {wanted.address(), static_cast<std::uint16_t>(next)})) continue;
      advice = fmt::format("; the next free one is {}: --port {}", next, next);
      break;
    }
    throw std::runtime_error(fmt::format("port {} of {} is taken{}", port, address, advice));
  }
  throw std::runtime_error(
      fmt::format("cannot listen on port {} of {}: {}", port, address, error.message()));
}

ServerInfo server_info(const ViewServer::Options& options) {
  ServerInfo info;
  info.name = options.title;
  info.capabilities = {"parameters", "parametersSubscribe"};
  if (!options.publishable.empty()) info.capabilities.emplace_back("clientPublish");
  if (options.has_time) info.capabilities.emplace_back("time");
  info.encodings = {"json"};
  info.session = random_token();
  return info;
}

}  // namespace

class ViewServer::Core {
 public:
  Core(const Options& options, std::unique_ptr<DerivedChannels> derived)
      : address_(listening_address(options.address)),
        hub_(
            {server_info(options), options.publishable},
            [this](ViewRequest r) { ask(std::move(r)); }, std::move(derived)),
        services_{hub_,
                  {0, options.token, options.origins},
                  PageFolder(options.page),
                  options.run_json,
                  options.site,
                  [this] { return status_json(); },
                  kMostClients},
        acceptor_(listen(io_, options.address, options.port)),
        gather_(io_),
        again_(io_) {
    services_.access.port = acceptor_.local_endpoint().port();
    accept();
    sigset_t all, before;  // signals are for the program's loop
    sigfillset(&all);
    pthread_sigmask(SIG_BLOCK, &all, &before);
    thread_ = std::thread([this] { io_.run(); });
    pthread_sigmask(SIG_SETMASK, &before, nullptr);
  }

  ~Core() {
    io_.stop();
    thread_.join();
  }
  Core(const Core&) = delete;
  Core& operator=(const Core&) = delete;

  std::string address() const {
    const bool is_v6 = address_.is_v6();
    std::string host = address_.to_string();
    if (is_everywhere()) host = is_v6 ? "::1" : "127.0.0.1";
    const std::string& token = services_.access.token;
    return fmt::format("http://{}:{}/{}", is_v6 ? "[" + host + "]" : host, port(),
                       token.empty() ? "" : "?token=" + token);
  }
  bool is_everywhere() const { return address_.is_unspecified(); }
  std::uint16_t port() const { return services_.access.port; }

  ViewInbox& inbox() { return inbox_; }
  RequestBox& requests() { return requests_; }

  /// The inbox is not empty any more.
  void wake() {
    asio::post(io_, [this] {
      if (!gathering_) deliver();
    });
  }

 private:
  void accept() {
    acceptor_.async_accept([this](const Error& error, tcp::socket socket) {
      if (error) {  // out of descriptors, say
        again_.expires_after(kAcceptAgain);
        again_.async_wait([this](const Error&) { accept(); });
        return;
      }
      serve_http(std::move(socket), services_);
      accept();
    });
  }

  void ask(ViewRequest request) {
    const ClientId client = request.client;
    if (requests_.put(std::move(request))) return;
    hub_.answer({client, std::nullopt, {}, "too many requests are waiting: this one was dropped"});
  }

  /// At once, and then not again before kGather has passed.
  void deliver() {
    inbox_.take(batch_);
    for (ViewInbox::Item& item : batch_.items) {
      std::visit([this](auto& one) { deliver(one); }, item);
    }
    pump_all();
    gathering_ = true;
    gather_.expires_after(kGather);
    gather_.async_wait([this](const Error&) {
      gathering_ = false;
      if (!inbox_.empty()) deliver();
    });
  }

  void pump_all() {
    for (const auto& [client, pump] : services_.pumps) pump();
  }

  void deliver(const ViewInbox::Heard& heard) {
    const auto* const begin = batch_.bytes.data() + heard.topic_begin;
    hub_.hear({reinterpret_cast<const char*>(begin), heard.topic_bytes},
              {begin + heard.topic_bytes, heard.data_bytes}, heard.time_ns);
  }
  void deliver(ViewInbox::Json& json) {
    hub_.publish(json.channel, json.time_ns, std::move(json.json));
  }
  void deliver(const std::vector<Parameter>& parameters) { hub_.update(parameters); }
  void deliver(const ViewAnswer& answer) { hub_.answer(answer); }
  void deliver(const ViewInbox::Status& status) { hub_.say(status.level, status.text); }
  void deliver(const ViewInbox::Time& time) { hub_.tell_time(time.time_ns); }

  std::string status_json() const {
    nlohmann::ordered_json status;
    for (const auto& [name, count] : hub_.counters()) status[name] = count;
    status["messages.dropped_before_server"] = inbox_.dropped();
    status["connections"] = services_.connections;
    status["connections.waiting"] = services_.waiting.size();
    status["requests.refused"] = services_.refused;
    return json_text(status);
  }

  asio::ip::address address_;
  ViewInbox inbox_;
  ViewInbox::Batch batch_;
  RequestBox requests_;
  Hub hub_;
  ViewServices services_;
  asio::io_context io_{1};  // ends before what its connections use
  tcp::acceptor acceptor_;
  asio::steady_timer gather_, again_;
  bool gathering_ = false;
  std::thread thread_;
};

ViewServer::ViewServer(const Options& options, std::unique_ptr<DerivedChannels> derived) {
  listening_address(options.address);
  if (options.token.empty() && !is_loopback(options.address)) {
    throw UsageError(
        fmt::format("address {}: other machines may come in there, so it needs a token: --token",
                    printable(options.address, kLongestNameShown)));
  }
  core_ = std::make_unique<Core>(options, std::move(derived));
}
ViewServer::~ViewServer() = default;

std::string ViewServer::address() const { return core_->address(); }
bool ViewServer::is_everywhere() const { return core_->is_everywhere(); }
std::uint16_t ViewServer::port() const { return core_->port(); }

void ViewServer::hear(std::string_view topic, std::span<const std::uint8_t> bytes,
                      std::uint64_t time_ns) {
  if (core_->inbox().hear(topic, bytes, time_ns)) core_->wake();
}
void ViewServer::publish(const DerivedChannels::Description& channel, std::uint64_t time_ns,
                         std::string json) {
  if (core_->inbox().put(ViewInbox::Json{channel, time_ns, std::move(json)})) core_->wake();
}
void ViewServer::update(std::vector<Parameter> parameters) {
  if (core_->inbox().put(std::move(parameters))) core_->wake();
}
void ViewServer::answer(ViewAnswer answer) {
  if (core_->inbox().put(std::move(answer))) core_->wake();
}
void ViewServer::say(StatusLevel level, std::string text) {
  if (core_->inbox().put(ViewInbox::Status{level, std::move(text)})) core_->wake();
}
void ViewServer::tell_time(std::uint64_t time_ns) {
  if (core_->inbox().put(ViewInbox::Time{time_ns})) core_->wake();
}
int ViewServer::requests_fd() const { return core_->requests().fd(); }
std::vector<ViewRequest> ViewServer::take_requests() { return core_->requests().take(); }

}  // namespace tether
