#include "doors/ros2/node/dds_bus.hpp"

#include <dds/dds.h>
#include <dds/ddsi/ddsi_serdata.h>
#include <fmt/format.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <array>
#include <cassert>
#include <condition_variable>
#include <deque>
#include <map>
#include <mutex>
#include <set>
#include <stdexcept>
#include <thread>
#include <utility>

#include "ros2.h"

namespace tether {
namespace {

struct TypeEntry {
  std::string_view ros;
  const dds_topic_descriptor_t* descriptor;
};

const std::array kTypes = {
    TypeEntry{kRosClock, &rosgraph_msgs_msg_dds__Clock__desc},
    TypeEntry{kRosTwist, &geometry_msgs_msg_dds__Twist__desc},
    TypeEntry{kRosTwistStamped, &geometry_msgs_msg_dds__TwistStamped__desc},
    TypeEntry{kRosPoseStamped, &geometry_msgs_msg_dds__PoseStamped__desc},
    TypeEntry{kRosOdometry, &nav_msgs_msg_dds__Odometry__desc},
    TypeEntry{kRosLaserScan, &sensor_msgs_msg_dds__LaserScan__desc},
    TypeEntry{kRosTf, &tf2_msgs_msg_dds__TFMessage__desc},
};

const dds_topic_descriptor_t* descriptor_of(std::string_view type) {
  for (const TypeEntry& entry : kTypes) {
    if (entry.ros == type) return entry.descriptor;
  }
  assert(false && "a type that ros2.idl has not");
  return nullptr;
}

dds_entity_t checked(dds_entity_t entity, const std::string& what) {
  if (entity > 0) return entity;
  throw std::runtime_error(fmt::format("ROS 2: {}: {}", what, dds_strretcode(entity)));
}

/// Settings of rmw_cyclonedds for LOCALHOST, with a period of discovery that is short.
std::string configuration(bool subnet) {
  constexpr std::string_view kCommon =
      "<SPDPInterval>500ms</SPDPInterval><ParticipantIndex>auto</ParticipantIndex>"
      "<MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>";
  if (subnet) return fmt::format("<Domain><Discovery>{}</Discovery></Domain>", kCommon);
  return fmt::format(
      "<Domain><General><AllowMulticast>false</AllowMulticast></General><Discovery>{}"
      "<Peers><Peer address=\"localhost\"/></Peers></Discovery></Domain>",
      kCommon);
}

using Qos = std::unique_ptr<dds_qos_t, decltype(&dds_delete_qos)>;

Qos make_qos(dds_reliability_kind_t reliability, bool keeps_for_late, std::int32_t depth) {
  Qos qos(dds_create_qos(), &dds_delete_qos);
  dds_qset_reliability(qos.get(), reliability, DDS_MSECS(100));
  dds_qset_durability(qos.get(),
                      keeps_for_late ? DDS_DURABILITY_TRANSIENT_LOCAL : DDS_DURABILITY_VOLATILE);
  dds_qset_history(qos.get(), DDS_HISTORY_KEEP_LAST, depth);
  const dds_data_representation_id_t xcdr1 = DDS_DATA_REPRESENTATION_XCDR1;
  dds_qset_data_representation(qos.get(), 1, &xcdr1);
  return qos;
}

std::string_view policy_name(std::uint32_t id) {
  switch (id) {
    case DDS_DURABILITY_QOS_POLICY_ID:
      return "durability";
    case DDS_DEADLINE_QOS_POLICY_ID:
      return "deadline";
    case DDS_LIVELINESS_QOS_POLICY_ID:
      return "liveliness";
    case DDS_RELIABILITY_QOS_POLICY_ID:
      return "reliability";
    case DDS_OWNERSHIP_QOS_POLICY_ID:
      return "ownership";
    case DDS_DATA_REPRESENTATION_QOS_POLICY_ID:
      return "data representation";
    case DDS_TYPE_CONSISTENCY_ENFORCEMENT_QOS_POLICY_ID:
      return "type consistency";
    default:
      return "another policy";
  }
}

}  // namespace

struct DdsBus::Impl {
  struct Offer {
    dds_entity_t writer;
    const ddsi_sertype* type;
  };
  struct Reader {
    Impl* owner;
    std::size_t number;
    std::string topic;
    dds_entity_t entity = 0;
  };
  /// Argument of a writer's listener.
  struct Writer {
    Impl* owner;
    std::string topic;
  };

  explicit Impl(const Settings& settings)
      : domain(checked(dds_create_domain(static_cast<dds_domainid_t>(settings.domain),
                                         configuration(settings.subnet).c_str()),
                       "the domain does not start")),
        participant(checked(
            dds_create_participant(static_cast<dds_domainid_t>(settings.domain), nullptr, nullptr),
            "no participant")),
        event(eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC)),
        thread([this] { write_all(); }) {}

  ~Impl() {
    {
      const std::lock_guard lock(mutex);
      ends = true;
    }
    queued.notify_all();
    thread.join();
    // Before what listeners refer to.
    for (ddsi_serdata* sample : samples) ddsi_serdata_unref(sample);
    dds_delete(domain);
    close(event);
  }

  dds_entity_t make_topic(const std::string& name, std::string_view type) {
    return checked(
        dds_create_topic(participant, descriptor_of(type), name.c_str(), nullptr, nullptr),
        "no topic " + name);
  }

  /// Cyclone's internal type, which a message of bytes needs. Only a received sample tells it, so
  /// the bus writes one to a private topic and takes it from there.
  const ddsi_sertype* internal_type(std::string_view type) {
    const auto known = types.find(type);
    if (known != types.end()) return known->second;
    const std::string name = fmt::format("tether_type/{}", type);
    const dds_entity_t topic = make_topic(name, type);
    const Qos qos = make_qos(DDS_RELIABILITY_RELIABLE, false, 1);
    const dds_entity_t reader =
        checked(dds_create_reader(participant, topic, qos.get(), nullptr), name);
    const dds_entity_t writer =
        checked(dds_create_writer(participant, topic, qos.get(), nullptr), name);
    const std::vector<std::uint64_t> zeros(descriptor_of(type)->m_size / 8 + 1);
    ddsi_serdata* sample = nullptr;
    dds_sample_info_t info;
    if (dds_write(writer, zeros.data()) != DDS_RETCODE_OK ||
        dds_takecdr(reader, &sample, 1, &info, DDS_ANY_STATE) != 1) {
      throw std::runtime_error("ROS 2: no sample of type " + std::string(type));
    }
    dds_delete(writer);
    dds_delete(reader);
    samples.push_back(sample);
    types.emplace(type, sample->type);
    return sample->type;
  }

  static void on_offered(dds_entity_t /*writer*/, dds_offered_incompatible_qos_status_t status,
                         void* self) {
    auto& writer = *static_cast<Writer*>(self);
    writer.owner->notice(
        fmt::format("{}: a subscriber asks for {} that this door does not offer: it gets nothing",
                    writer.topic, policy_name(status.last_policy_id)));
  }
  static void on_requested(dds_entity_t /*reader*/, dds_requested_incompatible_qos_status_t status,
                           void* self) {
    auto& reader = *static_cast<Reader*>(self);
    reader.owner->notice(
        fmt::format("{}: a publisher does not offer the {} that this door asks for: nothing of it "
                    "is heard",
                    reader.topic, policy_name(status.last_policy_id)));
  }
  static void on_data(dds_entity_t entity, void* self) {
    auto& reader = *static_cast<Reader*>(self);
    ddsi_serdata* sample = nullptr;
    dds_sample_info_t info;
    while (dds_takecdr(entity, &sample, 1, &info, DDS_ANY_STATE) == 1) {
      if (info.valid_data) {
        std::string cdr(ddsi_serdata_size(sample), '\0');
        ddsi_serdata_to_ser(sample, 0, cdr.size(), cdr.data());
        reader.owner->put({reader.number, info.publication_handle, std::move(cdr)});
      }
      ddsi_serdata_unref(sample);
    }
  }

  void put(Received received) {
    {
      const std::lock_guard lock(mutex);
      if (inbox.size() == kInbox) inbox.pop_front();
      inbox.push_back(std::move(received));
    }
    arrived.notify_all();
    eventfd_write(event, 1);
  }
  void notice(std::string line) {
    const std::lock_guard lock(mutex);
    if (known_notices.insert(line).second) notices.push_back(std::move(line));
    eventfd_write(event, 1);
  }

  void write_all() {
    std::unique_lock lock(mutex);
    while (true) {
      queued.wait(lock, [this] { return ends || !queue.empty(); });
      if (queue.empty()) return;
      const RosMessage message = std::move(queue.front());
      queue.pop_front();
      const Offer offer = offers.at(message.topic);
      lock.unlock();
      const bool is_written = write(offer, message.cdr);
      lock.lock();
      if (!is_written) ++dropped;
    }
  }
  static bool write(const Offer& offer, const std::string& cdr) {
    // Multiples of 4 bytes, as on the wire.
    std::string padded = cdr;
    padded.resize((cdr.size() + 3) / 4 * 4);
    ddsrt_iovec_t piece{};
    piece.iov_base = padded.data();
    piece.iov_len = padded.size();
    ddsi_serdata* const sample =
        ddsi_serdata_from_ser_iov(offer.type, SDK_DATA, 1, &piece, padded.size());
    return sample != nullptr && dds_writecdr(offer.writer, sample) == DDS_RETCODE_OK;
  }

  dds_entity_t domain, participant;
  int event;
  mutable std::mutex mutex;
  std::condition_variable queued, arrived;
  std::deque<RosMessage> queue;
  std::deque<Received> inbox;
  std::set<std::string> known_notices;
  std::vector<std::string> notices;
  std::int64_t dropped = 0;
  bool ends = false;
  std::map<std::string, Offer> offers;
  std::deque<Reader> readers;
  std::deque<Writer> writers;
  std::map<std::string_view, const ddsi_sertype*> types;
  std::vector<ddsi_serdata*> samples;
  std::thread thread;
};

DdsBus::DdsBus(const Settings& settings) : impl_(std::make_unique<Impl>(settings)) {}
DdsBus::~DdsBus() = default;

void DdsBus::advertise(const std::string& topic, std::string_view type) {
  const ddsi_sertype* const internal = impl_->internal_type(type);
  const bool is_static = topic.ends_with("tf_static");
  const Qos qos = make_qos(DDS_RELIABILITY_RELIABLE, is_static, is_static ? 1 : 100);
  Impl::Writer& self = impl_->writers.emplace_back(Impl::Writer{impl_.get(), topic});
  dds_listener_t* const listener = dds_create_listener(&self);
  dds_lset_offered_incompatible_qos(listener, Impl::on_offered);
  const dds_entity_t writer = dds_create_writer(
      impl_->participant, impl_->make_topic("rt" + topic, type), qos.get(), listener);
  dds_delete_listener(listener);
  checked(writer, "no writer of " + topic);
  const std::lock_guard lock(impl_->mutex);
  impl_->offers[topic] = {writer, internal};
}

void DdsBus::publish(RosMessage message) {
  {
    const std::lock_guard lock(impl_->mutex);
    assert(impl_->offers.contains(message.topic));
    if (impl_->queue.size() == kQueue) {
      impl_->queue.pop_front();
      ++impl_->dropped;
    }
    impl_->queue.push_back(std::move(message));
  }
  impl_->queued.notify_one();
}

std::size_t DdsBus::subscribe(const std::string& topic, std::string_view type) {
  const std::size_t number = impl_->readers.size();
  Impl::Reader& self = impl_->readers.emplace_back(Impl::Reader{impl_.get(), number, topic});
  const Qos qos = make_qos(DDS_RELIABILITY_BEST_EFFORT, false, 10);
  dds_listener_t* const listener = dds_create_listener(&self);
  dds_lset_data_available(listener, Impl::on_data);
  dds_lset_requested_incompatible_qos(listener, Impl::on_requested);
  self.entity = dds_create_reader(impl_->participant, impl_->make_topic("rt" + topic, type),
                                  qos.get(), listener);
  dds_delete_listener(listener);
  checked(self.entity, "no reader of " + topic);
  return number;
}

std::vector<DdsBus::Received> DdsBus::take() {
  eventfd_t count = 0;
  eventfd_read(impl_->event, &count);
  const std::lock_guard lock(impl_->mutex);
  std::vector<Received> all(std::make_move_iterator(impl_->inbox.begin()),
                            std::make_move_iterator(impl_->inbox.end()));
  impl_->inbox.clear();
  return all;
}

bool DdsBus::wait(Duration timeout) {
  std::unique_lock lock(impl_->mutex);
  return impl_->arrived.wait_for(lock, timeout, [this] { return !impl_->inbox.empty(); });
}

int DdsBus::fd() const { return impl_->event; }

std::string DdsBus::name(const Received& received) const {
  dds_builtintopic_endpoint_t* const publisher = dds_get_matched_publication_data(
      impl_->readers[received.subscription].entity, received.publisher);
  if (publisher == nullptr) return fmt::format("publisher {:x}, which is gone", received.publisher);
  std::string text;
  for (const unsigned char byte : publisher->key.v) text += fmt::format("{:02x}", byte);
  dds_builtintopic_free_endpoint(publisher);
  return text;
}

std::vector<std::string> DdsBus::notices() {
  const std::lock_guard lock(impl_->mutex);
  return std::exchange(impl_->notices, {});
}

std::int64_t DdsBus::dropped() const {
  const std::lock_guard lock(impl_->mutex);
  return impl_->dropped;
}

}  // namespace tether
