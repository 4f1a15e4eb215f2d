// A ROS 2 node in miniature on Fast DDS, ROS 2's default middleware: bytes of CDR under its names.
//
//   fast_dds_peer DOMAIN listen TOPIC TYPE SECONDS
//   fast_dds_peer DOMAIN drive twist|stamped SECONDS
//                 [frame=F] [v=V] [age_ms=A] [best_effort] [space=/agv1/]
//
// Both print "N messages, B bytes" of what they have heard, B of the last one.
// drive answers each /pose with one command of 0.5 m/s on /cmd_vel; stamped: with the pose's stamp.
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/Topic.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <string>
#include <thread>

namespace {

using namespace eprosima::fastdds::dds;
using eprosima::fastrtps::rtps::InstanceHandle_t;
using eprosima::fastrtps::rtps::SerializedPayload_t;

/// Any type: its data are the bytes of a std::string, with the encapsulation.
class Bytes final : public TopicDataType {
 public:
  explicit Bytes(const std::string& name) {
    setName(name.c_str());
    m_typeSize = 100'000;
    m_isGetKeyDefined = false;
  }
  bool serialize(void* data, SerializedPayload_t* payload) override {
    const auto& bytes = *static_cast<std::string*>(data);
    std::memcpy(payload->data, bytes.data(), bytes.size());
    payload->length = static_cast<std::uint32_t>(bytes.size());
    payload->encapsulation = CDR_LE;
    return true;
  }
  bool deserialize(SerializedPayload_t* payload, void* data) override {
    static_cast<std::string*>(data)->assign(reinterpret_cast<char*>(payload->data),
                                            payload->length);
    return true;
  }
  std::function<std::uint32_t()> getSerializedSizeProvider(void* data) override {
    return [data] { return static_cast<std::uint32_t>(static_cast<std::string*>(data)->size()); };
  }
  void* createData() override { return new std::string; }
  void deleteData(void* data) override { delete static_cast<std::string*>(data); }
  bool getKey(void*, InstanceHandle_t*, bool) override { return false; }
};

/// "geometry_msgs/msg/Twist" is geometry_msgs::msg::dds_::Twist_ on the wire.
std::string dds_name(const std::string& type) {
  const auto slash = type.find('/');
  return type.substr(0, slash) + "::msg::dds_::" + type.substr(type.rfind('/') + 1) + "_";
}

struct Peer {
  explicit Peer(int domain)
      : participant(DomainParticipantFactory::get_instance()->create_participant(
            static_cast<std::uint32_t>(domain), PARTICIPANT_QOS_DEFAULT)),
        publisher(participant->create_publisher(PUBLISHER_QOS_DEFAULT)),
        subscriber(participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT)) {}
  ~Peer() {
    participant->delete_contained_entities();
    DomainParticipantFactory::get_instance()->delete_participant(participant);
  }
  Topic* topic(const std::string& name, const std::string& type) {
    TypeSupport(new Bytes(dds_name(type))).register_type(participant);
    return participant->create_topic("rt" + name, dds_name(type), TOPIC_QOS_DEFAULT);
  }
  DataReader* reader(const std::string& name, const std::string& type, DataReaderListener* to) {
    DataReaderQos qos = DATAREADER_QOS_DEFAULT;
    qos.reliability().kind = RELIABLE_RELIABILITY_QOS;
    qos.history().depth = 100;
    if (name.ends_with("tf_static")) qos.durability().kind = TRANSIENT_LOCAL_DURABILITY_QOS;
    return subscriber->create_datareader(topic(name, type), qos, to);
  }
  DataWriter* writer(const std::string& name, const std::string& type, bool best_effort) {
    DataWriterQos qos = DATAWRITER_QOS_DEFAULT;
    qos.reliability().kind = best_effort ? BEST_EFFORT_RELIABILITY_QOS : RELIABLE_RELIABILITY_QOS;
    return publisher->create_datawriter(topic(name, type), qos);
  }

  DomainParticipant* participant;
  Publisher* publisher;
  Subscriber* subscriber;
};

class Counting : public DataReaderListener {
 public:
  void on_data_available(DataReader* reader) override {
    std::string bytes;
    SampleInfo info;
    while (reader->take_next_sample(&bytes, &info) == ReturnCode_t::RETCODE_OK) {
      if (!info.valid_data) continue;
      ++count;
      size = bytes.size();
      on_message(bytes);
    }
  }
  virtual void on_message(const std::string& /*bytes*/) {}
  std::atomic<int> count = 0;
  std::atomic<std::size_t> size = 0;
};

struct Driver final : Counting {
  DataWriter* out = nullptr;
  bool stamped = false;
  std::string frame = "base_link";
  double v_mps = 0.5;
  int age_ms = 0;

  void on_message(const std::string& pose) override {
    std::string bytes("\0\1\0\0", 4);
    const auto align = [&](std::size_t to) {
      while ((bytes.size() - 4) % to != 0) bytes += '\0';
    };
    if (stamped) {
      std::int32_t seconds = 0;
      std::memcpy(&seconds, pose.data() + 4, 4);
      seconds -= age_ms / 1000;
      bytes.append(reinterpret_cast<const char*>(&seconds), 4);
      bytes.append(pose, 8, 4);
      const auto size = static_cast<std::uint32_t>(frame.size() + 1);
      bytes.append(reinterpret_cast<const char*>(&size), 4);
      bytes.append(frame.c_str(), size);
      align(8);
    }
    const double numbers[6] = {v_mps, 0, 0, 0, 0, 0.05};
    bytes.append(reinterpret_cast<const char*>(numbers), sizeof numbers);
    out->write(&bytes);
  }
};

}  // namespace

int main(int argc, char** argv) {
  if (argc < 5) return 2;
  Peer peer(std::atoi(argv[1]));
  const std::string mode = argv[2];
  Counting counting;
  Driver driver;
  Counting& heard = mode == "listen" ? counting : driver;
  double seconds = 0.0;
  if (mode == "listen") {
    if (argc < 6) return 2;
    seconds = std::atof(argv[5]);
    peer.reader(argv[3], argv[4], &counting);
  } else {
    driver.stamped = std::string(argv[3]) == "stamped";
    seconds = std::atof(argv[4]);
    bool best_effort = false;
    std::string space = "/";
    for (int i = 5; i < argc; ++i) {
      const std::string option = argv[i];
      if (option.starts_with("frame=")) driver.frame = option.substr(6);
      if (option.starts_with("v=")) driver.v_mps = std::atof(option.c_str() + 2);
      if (option.starts_with("age_ms=")) driver.age_ms = std::atoi(option.c_str() + 7);
      if (option.starts_with("space=")) space = option.substr(6);
      best_effort = best_effort || option == "best_effort";
    }
    driver.out = peer.writer(
        space + "cmd_vel",
        driver.stamped ? "geometry_msgs/msg/TwistStamped" : "geometry_msgs/msg/Twist", best_effort);
    peer.reader(space + "pose", "geometry_msgs/msg/PoseStamped", &driver);
  }
  std::this_thread::sleep_for(std::chrono::duration<double>(seconds));
  std::printf("%d messages, %zu bytes\n", heard.count.load(), heard.size.load());
  return 0;
}
