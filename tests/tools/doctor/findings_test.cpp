#include "tools/doctor/findings.hpp"

#include <gmock/gmock.h>

namespace tether {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;
using Verdict = DoctorFinding::Verdict;

/// On which everything works.
Machine sound() {
  Machine m;
  m.version = "0.1.0+abc";
  m.kernel = "6.1.0";
  m.lcm_url = "udpm://239.255.76.67:7667?ttl=1";
  m.multicast_by = "10.0.0.2";
  m.echo_ms = 0.1;
  m.rmem_max_bytes = 8'388'608;
  m.clock_synchronised = true;
  m.clock_error_max_ms = 3.0;
  m.can["can0"] = {.is_can = true, .up = true};
  m.can_asked = "can0";
  m.may_be_realtime = m.may_lock_memory = true;
  m.governors["performance"] = 4;
  return m;
}

DoctorFinding about(const Machine& machine, const std::string& what) {
  for (const DoctorFinding& finding : findings_of(machine)) {
    if (finding.about == what) return finding;
  }
  ADD_FAILURE() << "nothing about " << what;
  return {};
}

void expect(const Machine& machine, const std::string& what, Verdict verdict,
            const std::string& to_do) {
  const DoctorFinding finding = about(machine, what);
  EXPECT_EQ(finding.verdict, verdict) << finding.what;
  EXPECT_THAT(finding.to_do, HasSubstr(to_do));
  EXPECT_EQ(is_anything_wrong(findings_of(machine)), verdict == Verdict::wrong);
}

TEST(Doctor, HasNothingToSayOfASoundMachine) {
  for (const DoctorFinding& finding : findings_of(sound())) {
    EXPECT_EQ(finding.verdict, Verdict::good) << finding.about;
    EXPECT_EQ(finding.to_do, "") << finding.about;
  }
}

TEST(Doctor, NamesProgramsOfAnotherVersionBesideIt) {
  Machine m = sound();
  m.other_versions["tether-link"] = "0.2.0+def";
  expect(m, "versions", Verdict::wrong, "apt install ./tether*.deb");
  EXPECT_THAT(about(m, "versions").what,
              HasSubstr("Tether 0.1.0+abc, Linux 6.1.0; but beside it tether-link: 0.2.0+def"));
}

TEST(Doctor, SaysHowToMakeARouteWhereThereIsNone) {
  Machine m = sound();
  m.multicast_by = "";
  m.multicast_trouble = "Network is unreachable";
  m.echo_ms.reset();
  expect(m, "multicast", Verdict::wrong, "ip route add 239.255.76.67/32 dev lo");
  EXPECT_EQ(about(m, "messages").verdict, Verdict::note);
}

TEST(Doctor, FailsWhereAnLcmNetworkOfThisHostLeavesByARadio) {
  Machine m = sound();
  m.lcm_url = "udpm://239.255.76.67:7667?ttl=0";
  m.multicast_interface = "wlan0";
  m.multicast_by_radio = true;
  expect(m, "multicast", Verdict::wrong, "enable --now tether-host");
  EXPECT_THAT(about(m, "multicast").what, HasSubstr("is reached by 10.0.0.2, wlan0: LCM's own"));
  m.multicast_by_radio = false;
  expect(m, "multicast", Verdict::note, "tether-vehicle lcm-route");
  m.multicast_interface = "lo";
  expect(m, "multicast", Verdict::good, "");
  m.lcm_url = "udpm://239.255.76.67:7667?ttl=1";
  expect(m, "multicast", Verdict::note, "ip route del 239.255.76.67/32 dev lo");
}

TEST(Doctor, TellsAFirewallFromATakenPort) {
  Machine m = sound();
  m.echo_ms.reset();
  expect(m, "messages", Verdict::wrong, "firewall");
  m.port_trouble = "binding to the port of udpm://239.255.76.67:7667: Address already in use";
  expect(m, "messages", Verdict::wrong, "sport = 7667");
}

TEST(Doctor, WantsBuffersOfTwoMebibytes) {
  Machine m = sound();
  m.rmem_max_bytes = 2'097'151;
  expect(m, "buffers", Verdict::note, "sysctl -w net.core.rmem_max=8388608");
  m.rmem_max_bytes = 2'097'152;
  expect(m, "buffers", Verdict::good, "");
}

TEST(Doctor, WantsAClockThatIsSynchronisedToATenthOfWhatBreaksPlans) {
  Machine m = sound();
  m.clock_error_max_ms = 20.0;
  expect(m, "clock", Verdict::good, "");
  m.clock_error_max_ms = 20.1;
  expect(m, "clock", Verdict::note, "time server");
  m.clock_synchronised = false;
  expect(m, "clock", Verdict::note, "apt install chrony");
  m.has_chrony = true;
  expect(m, "clock", Verdict::note, "chronyc sources");
  EXPECT_THAT(about(m, "clock").to_do, Not(HasSubstr("apt install")));
}

TEST(Doctor, LooksAtTheCanInterfaceThatWasAskedAbout) {
  Machine m = sound();
  m.can["can0"].up = false;
  expect(m, "CAN", Verdict::wrong, "ip link set can0 up type can bitrate");
  m.can["can0"] = {.is_can = false, .up = true};
  expect(m, "CAN", Verdict::wrong, "link show type can");
  m.can.clear();
  expect(m, "CAN", Verdict::wrong, "adapter");
  m.can_asked = "vcan0";
  expect(m, "CAN", Verdict::wrong, "ip link add dev vcan0 type vcan");
  m.can_asked = "";
  expect(m, "CAN", Verdict::good, "");
}

TEST(Doctor, NamesTheRightsAndTheGovernorsThatAreNotAsTheyShouldBe) {
  Machine m = sound();
  m.may_be_realtime = false;
  expect(m, "real time", Verdict::note, "LimitRTPRIO");
  EXPECT_THAT(about(m, "real time").what, HasSubstr("SCHED_FIFO"));
  EXPECT_THAT(about(m, "real time").to_do, Not(HasSubstr("LimitMEMLOCK")));
  std::swap(m.may_be_realtime, m.may_lock_memory);
  EXPECT_EQ(about(m, "real time").to_do,
            "LimitMEMLOCK=infinity in a unit, or in /etc/security/limits.d");
  m.governors["powersave"] = 2;
  expect(m, "processors", Verdict::note, "performance");
  m.missing_programs = {"java"};
  expect(m, "programs", Verdict::note, "default-jre");
  EXPECT_THAT(about(m, "programs").to_do, Not(HasSubstr("gnuplot")));
}

TEST(Doctor, LooksAtPeersAndTheirClocksWhereItIsAsked) {
  Machine m = sound();
  m.link_asked = true;
  expect(m, "link", Verdict::wrong, "status tether-link");
  m.peers["vehicle7"] = {.up = true};
  m.peers["vehicle8"] = {.up = true};
  expect(m, "link", Verdict::good, "");
  EXPECT_EQ(about(m, "link").what, "up: vehicle7, vehicle8; clocks agree");
  m.peers["vehicle8"] = {true, true, 51.0, 60.0};
  expect(m, "link", Verdict::wrong, "chronyc");
  EXPECT_EQ(about(m, "link").what, "clocks are ahead of ours: vehicle8 by 51 to 60 ms");
  m.peers["vehicle7"].up = false;
  expect(m, "link", Verdict::wrong, "journalctl");
  EXPECT_EQ(about(m, "link").what, "down: vehicle7");
}

TEST(Doctor, SaysWhetherALatencyFitsTheCycle) {
  Latency l{
      .wakeups = 10000, .worst_ms = 4.9, .p999_ms = 0.2, .seconds = 10.0, .is_realtime = true};
  const DoctorFinding good = finding_of(l, 20.0);
  EXPECT_EQ(good.verdict, Verdict::good);
  EXPECT_EQ(good.what,
            "worst 4.90 ms, 99.9 % below 0.20 ms, of 10000 wake-ups in 10 s under load, at a cycle "
            "of 20 ms");
  const DoctorFinding late = finding_of(l, 10.0);
  EXPECT_EQ(late.verdict, Verdict::note);
  EXPECT_THAT(late.to_do, HasSubstr("PREEMPT_RT"));
  l.realtime_kernel = true;
  EXPECT_THAT(finding_of(l, 10.0).to_do,
              AllOf(HasSubstr("isolcpus"), Not(HasSubstr("PREEMPT_RT"))));
  l.is_realtime = false;
  const DoctorFinding wrong = finding_of(l, 4.0);
  EXPECT_EQ(wrong.verdict, Verdict::wrong);
  EXPECT_THAT(wrong.to_do, HasSubstr("LimitRTPRIO"));
  EXPECT_THAT(wrong.what, HasSubstr("without SCHED_FIFO"));
}

TEST(Doctor, WritesAVerdictAndWhatToDoToEach) {
  Machine m = sound();
  m.clock_synchronised = false;
  const std::string text = text_of(findings_of(m));
  EXPECT_THAT(text, HasSubstr("ok     multicast   239.255.76.67 is reached by 10.0.0.2\n"));
  EXPECT_THAT(text, HasSubstr("note   clock       not synchronised"));
  EXPECT_THAT(text, HasSubstr("\n                   → sudo apt install chrony"));
}

}  // namespace
}  // namespace tether
