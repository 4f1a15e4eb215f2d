#include "tools/view/swept/made_pages.hpp"

#include <exception>
#include <utility>

namespace tether {
namespace {

/// The work is not wanted any more.
struct GivenUp {};

}  // namespace

MadePages::MadePages(Make make)
    : make_(std::move(make)), worker_([this](const std::stop_token& stop) { work(stop); }) {}

MadePage MadePages::ask(const std::string& name) {
  const std::lock_guard lock(mutex_);
  if (const auto found = pages_.find(name); found != pages_.end()) return found->second;
  if (waiting_.size() >= kMostWaiting) {
    return {.state = MadePage::State::failed,
            .error = "too many runs are waiting to be computed: try again later"};
  }
  waiting_.push_back(name);
  asked_.notify_one();
  return pages_[name];
}

std::shared_ptr<const std::string> MadePages::find(const std::string& name) const {
  const std::lock_guard lock(mutex_);
  const auto found = pages_.find(name);
  return found == pages_.end() ? nullptr : found->second.page;
}

void MadePages::work(const std::stop_token& stop) {
  for (;;) {
    std::string name;
    {
      std::unique_lock lock(mutex_);
      if (!asked_.wait(lock, stop, [this] { return !waiting_.empty(); })) return;
      name = std::move(waiting_.front());
      waiting_.pop_front();
      pages_[name].state = MadePage::State::in_work;
    }
    try {
      finish(name, made(name, stop));
    } catch (const GivenUp&) {
      return;
    }
  }
}

MadePage MadePages::made(const std::string& name, const std::stop_token& stop) {
  const Progress tell = [&](double share) {
    if (stop.stop_requested()) throw GivenUp();
    const std::lock_guard lock(mutex_);
    pages_[name].share = share;
  };
  try {
    return {.state = MadePage::State::ready,
            .share = 1.0,
            .page = std::make_shared<const std::string>(make_(name, tell))};
  } catch (const std::exception& error) {
    return {.state = MadePage::State::failed, .error = error.what()};
  }
}

void MadePages::finish(const std::string& name, MadePage page) {
  const std::lock_guard lock(mutex_);
  pages_[name] = std::move(page);
  kept_.push_back(name);
  if (kept_.size() <= kMostKept) return;
  pages_.erase(kept_.front());
  kept_.pop_front();
}

}  // namespace tether
