// One access point and its stations, 802.11a, in ns-3: a judge of Tether's shared medium. ns-3 is
// under the GPL, so this is a separate program without any code of Tether, and is not installed.
// Prints one JSON line.

#include <ns3/core-module.h>
#include <ns3/mobility-module.h>
#include <ns3/network-module.h>
#include <ns3/propagation-module.h>
#include <ns3/wifi-module.h>

#include <algorithm>
#include <cstdint>
#include <iostream>
#include <map>
#include <string>
#include <vector>

using namespace ns3;

namespace {

/// MAC header of data, LLC and SNAP, FCS: what a frame has beside the payload of NetDevice::Send().
constexpr std::uint32_t kOverheadBytes = 24 + 8 + 4;
constexpr std::uint16_t kProtocol = 0x88b5;  ///< for experiments

/// Packets that are sent within the time that counts, and their delays.
struct Way {
  std::map<std::uint64_t, Time> sent;
  std::vector<double> delays_us;
  std::uint64_t all = 0;

  void note_sent(const Ptr<Packet>& packet) {
    sent[packet->GetUid()] = Simulator::Now();
    ++all;
  }
  void note_received(const Ptr<const Packet>& packet) {
    const auto found = sent.find(packet->GetUid());
    if (found == sent.end()) return;
    delays_us.push_back((Simulator::Now() - found->second).GetNanoSeconds() * 1e-3);
    sent.erase(found);
  }
  std::string json() {
    std::sort(delays_us.begin(), delays_us.end());
    double sum = 0.0;
    for (const double d : delays_us) sum += d;
    const double n = static_cast<double>(delays_us.size());
    const double p95 = delays_us.empty() ? 0.0 : delays_us[static_cast<std::size_t>(0.95 * n)];
    return "{\"sent\": " + std::to_string(all) +
           ", \"delivered\": " + std::to_string(delays_us.size()) +
           ", \"mean_us\": " + std::to_string(n > 0.0 ? sum / n : 0.0) +
           ", \"p95_us\": " + std::to_string(p95) + "}";
  }
};

struct Options {
  std::uint32_t stations = 5;
  std::string pattern = "saturated";  ///< saturated: all send; loop: 20 Hz up, each answered
  std::uint32_t up_bytes = 1500, down_bytes = 137;  ///< MAC frame with header and FCS
  double seconds = 1.0;
  std::uint32_t seed = 1;
  std::string manager = "constant";  ///< constant, minstrel, aarf
  bool hidden = false;               ///< stations do not hear each other
  bool rts = false;
};

class Cell {
 public:
  explicit Cell(const Options& options) : options_(options) {
    nodes_.Create(options.stations + 1);
    install();
    access_point_ = DynamicCast<WifiNetDevice>(devices_.Get(0));
    access_point_->SetReceiveCallback(MakeCallback(&Cell::at_access_point, this));
    const Ptr<UniformRandomVariable> phase = CreateObject<UniformRandomVariable>();
    for (std::uint32_t i = 1; i <= options.stations; ++i) {
      devices_.Get(i)->SetReceiveCallback(MakeCallback(&Cell::at_station, this));
      const Time period = is_saturated() ? Seconds(options.stations / 8000.0) : MilliSeconds(50);
      Simulator::Schedule(kAssociated + period * phase->GetValue(), &Cell::send_up, this, i,
                          period);
    }
  }

  void run() {
    Simulator::Stop(kCounts + Seconds(options_.seconds) + MilliSeconds(600));
    Simulator::Run();
    std::cout << "{\"up\": " << up_.json() << ", \"down\": " << down_.json() << "}" << std::endl;
    Simulator::Destroy();
  }

 private:
  bool is_saturated() const { return options_.pattern == "saturated"; }
  bool counts() const {
    return Simulator::Now() >= kCounts && Simulator::Now() < kCounts + Seconds(options_.seconds);
  }

  void install() {
    Ptr<YansWifiChannel> channel = CreateObject<YansWifiChannel>();
    channel->SetPropagationDelayModel(CreateObject<ConstantSpeedPropagationDelayModel>());
    MobilityHelper mobility;
    Ptr<ListPositionAllocator> places = CreateObject<ListPositionAllocator>();
    for (std::uint32_t i = 0; i <= options_.stations; ++i) places->Add(Vector(0.01 * i, 0.0, 0.0));
    mobility.SetPositionAllocator(places);
    mobility.SetMobilityModel("ns3::ConstantPositionMobilityModel");
    mobility.Install(nodes_);
    if (options_.hidden) {
      Ptr<MatrixPropagationLossModel> losses = CreateObject<MatrixPropagationLossModel>();
      losses->SetDefaultLoss(300.0);
      for (std::uint32_t i = 1; i <= options_.stations; ++i) {
        losses->SetLoss(nodes_.Get(0)->GetObject<MobilityModel>(),
                        nodes_.Get(i)->GetObject<MobilityModel>(), 50.0);
      }
      channel->SetPropagationLossModel(losses);
    } else {
      Ptr<FixedRssLossModel> loss = CreateObject<FixedRssLossModel>();
      loss->SetRss(-40.0);
      channel->SetPropagationLossModel(loss);
    }
    YansWifiPhyHelper phy;
    phy.SetChannel(channel);
    phy.DisablePreambleDetectionModel();
    WifiHelper wifi;
    wifi.SetStandard(WIFI_STANDARD_80211a);
    const UintegerValue threshold(options_.rts ? 0 : 65535);
    if (options_.manager == "constant") {
      wifi.SetRemoteStationManager("ns3::ConstantRateWifiManager", "DataMode",
                                   StringValue("OfdmRate54Mbps"), "ControlMode",
                                   StringValue("OfdmRate24Mbps"), "RtsCtsThreshold", threshold);
    } else {
      wifi.SetRemoteStationManager(
          options_.manager == "aarf" ? "ns3::AarfWifiManager" : "ns3::MinstrelWifiManager",
          "RtsCtsThreshold", threshold);
    }
    WifiMacHelper mac;
    mac.SetType("ns3::ApWifiMac", "Ssid", SsidValue(Ssid("tether")));
    devices_.Add(wifi.Install(phy, mac, nodes_.Get(0)));
    mac.SetType("ns3::StaWifiMac", "Ssid", SsidValue(Ssid("tether")), "ActiveProbing",
                BooleanValue(false), "MaxMissedBeacons", UintegerValue(1000000));
    for (std::uint32_t i = 1; i <= options_.stations; ++i)
      devices_.Add(wifi.Install(phy, mac, nodes_.Get(i)));
    Config::Set("/NodeList/*/DeviceList/*/$ns3::WifiNetDevice/Mac/Txop/Queue/MaxSize",
                QueueSizeValue(QueueSize(is_saturated() ? "5p" : "100p")));
  }

  void send_up(std::uint32_t station, Time period) {
    Ptr<Packet> packet = Create<Packet>(options_.up_bytes - kOverheadBytes);
    if (counts()) up_.note_sent(packet);
    devices_.Get(station)->Send(packet, access_point_->GetAddress(), kProtocol);
    Simulator::Schedule(period, &Cell::send_up, this, station, period);
  }

  bool at_access_point(Ptr<NetDevice>, Ptr<const Packet> packet, std::uint16_t,
                       const Address& from) {
    if (is_saturated()) {
      // Each that comes within the time counts, whenever it was sent.
      if (counts()) up_.delays_us.push_back(0.0);
      return true;
    }
    up_.note_received(packet);
    Ptr<Packet> answer = Create<Packet>(options_.down_bytes - kOverheadBytes);
    if (counts()) down_.note_sent(answer);
    access_point_->Send(answer, from, kProtocol);
    return true;
  }

  bool at_station(Ptr<NetDevice>, Ptr<const Packet> packet, std::uint16_t, const Address&) {
    down_.note_received(packet);
    return true;
  }

  const Time kAssociated = Seconds(2.0), kCounts = Seconds(4.0);
  Options options_;
  NodeContainer nodes_;
  NetDeviceContainer devices_;
  Ptr<WifiNetDevice> access_point_;
  Way up_, down_;
};

}  // namespace

int main(int argc, char** argv) {
  Options options;
  CommandLine command;
  command.AddValue("stations", "stations of the access point", options.stations);
  command.AddValue("pattern", "saturated or loop", options.pattern);
  command.AddValue("up", "bytes of a MAC frame up", options.up_bytes);
  command.AddValue("down", "bytes of a MAC frame down", options.down_bytes);
  command.AddValue("seconds", "simulated time that counts", options.seconds);
  command.AddValue("seed", "seed of ns-3's random numbers", options.seed);
  command.AddValue("manager", "constant, minstrel or aarf", options.manager);
  command.AddValue("hidden", "stations do not hear each other", options.hidden);
  command.AddValue("rts", "RTS and CTS before each frame", options.rts);
  command.Parse(argc, argv);
  RngSeedManager::SetRun(options.seed);
  Cell(options).run();
}
