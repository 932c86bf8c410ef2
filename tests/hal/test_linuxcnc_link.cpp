// The LinuxCNC link against a server of our own that misbehaves, and against LinuxCNC itself where
// SERVOSENSE_LINUXCNC says where it is (tests/linuxcnc/cnc.sh starts one).
#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <functional>
#include <memory>
#include <random>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "check.hpp"
#include "loopback.hpp"
#include "servosense/hal/cnc_channel.hpp"
#include "servosense/hal/linuxcnc_link.hpp"
#include "servosense/hal/override_request.hpp"
#include "servosense/hal/stop_request.hpp"

using namespace servosense;

namespace {

// What linuxcncrsh 2.9 answers, as it was heard from the real one, and whatever else is wanted.
class Server {
 public:
  /// Reply to a request, without line ends; "" none, "<drop>" hangs up.
  using Answer = std::function<std::string(const std::string& request, std::string usual)>;
  explicit Server(Answer answer) : answer_(std::move(answer)) {
    listener_ = listen_on_loopback(config.port);
    if (listener_ < 0) return;
    config.time_limit_s = 0.05;
    thread_ = std::thread([this] { run(); });
  }
  Server(const Server&) = delete;
  Server& operator=(const Server&) = delete;
  ~Server() {
    stop_ = true;
    if (thread_.joinable()) thread_.join();
    ::close(listener_);
  }
  LinuxCncConfig config;
  std::atomic<int> connections{0};
  std::atomic<int> blocks{0};
  std::atomic<bool> paused{false}, control{true}, spindle_slowed{false};

 private:
  static bool readable(int fd) {
    pollfd p{fd, POLLIN, 0};
    return ::poll(&p, 1, 10) > 0;
  }
  std::string usual(const std::string& request) {
    if (request.starts_with("hello")) {
      control = true;
      return "HELLO ACK EMCNETSVR 1.1";
    }
    if (request.starts_with("set ")) {
      if (request == "set echo off") return request;
      std::string what = request.substr(4, request.find(' ', 4) - 4);
      for (char& c : what) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
      if (!control) return "SET " + what + " NAK";
      if (what == "PAUSE") paused = true;
      if (what == "RESUME") paused = false;
      if (what == "MDI") ++blocks;
      if (request == "set spindle_override 0 85") spindle_slowed = true;
      return "SET " + what + " ACK";
    }
    if (request == "get enable") return control ? "ENABLE ON" : "ENABLE OFF";
    if (request == "get estop") return "ESTOP OFF";
    if (request == "get machine") return "MACHINE ON";
    if (request == "get mode") return "MODE MDI";
    if (request == "get error") return "ERROR OK";
    if (request == "get program_status")
      return paused ? "PROGRAM_STATUS PAUSED" : "PROGRAM_STATUS IDLE";
    if (request == "get abs_act_pos")
      return "ABS_ACT_POS 4.870000 -0.500000 100.000000 0.000000 0.000000 0.000000";
    if (request == "get feed_override") return "FEED_OVERRIDE 80";
    if (request == "get spindle_override 0") return "SPINDLE_OVERRIDE 0 110";
    return "?Unknown";
  }
  void run() {
    while (!stop_) {
      if (!readable(listener_)) continue;
      const int client = ::accept(listener_, nullptr, nullptr);
      ++connections;
      const int yes = 1;  // or the second piece waits for the first to be acknowledged
      setsockopt(client, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
      std::string input;
      for (bool on = true; on && !stop_;) {
        if (!readable(client)) continue;
        char bytes[256];
        const ssize_t n = ::recv(client, bytes, sizeof bytes, 0);
        if (n <= 0) break;
        input.append(bytes, static_cast<std::size_t>(n));
        for (std::size_t end = 0; on && (end = input.find("\r\n")) != std::string::npos;
             input.erase(0, end + 2)) {
          const std::string request = input.substr(0, end);
          const std::string reply = answer_(request, usual(request));
          on = reply != "<drop>";
          if (!on || reply.empty()) continue;
          // Line ends as the real one has them, in two pieces.
          const std::string line = reply + (request.starts_with("set") ? "\n\r" : "\r\n");
          ::send(client, line.data(), line.size() / 2, MSG_NOSIGNAL);
          ::send(client, line.data() + line.size() / 2, line.size() - line.size() / 2,
                 MSG_NOSIGNAL);
        }
      }
      ::close(client);
    }
  }

  Answer answer_;
  int listener_ = -1;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

void a_proper_server() {
  Server server([](const std::string&, std::string usual) { return usual; });
  LinuxCncLink link(server.config);
  CncStatus status;
  CHECK(link.status(status) == CncReply::no_answer);  // not connected yet
  CHECK(link.connect() == CncReply::done);
  CHECK(link.status(status) == CncReply::done);
  CHECK(status.on && !status.moving && !status.feed_held && status.feed_override == 0.8);
  CHECK_NEAR(status.position_m[0], 4.87e-3, 1e-12);
  CHECK_NEAR(status.position_m[1], -0.5e-3, 1e-12);
  CHECK_NEAR(status.position_m[2], 0.1, 1e-12);
  CncOverrides overrides;
  CHECK(link.overrides(overrides) == CncReply::done);
  CHECK(overrides.feed == 0.8 && overrides.spindle == 1.1);
  CHECK(link.set_spindle_override(0.852) == CncReply::done && server.spindle_slowed);
  CHECK(link.hold_feed(true) == CncReply::done && server.paused);
  CHECK(link.status(status) == CncReply::done && status.feed_held);
  CHECK(link.hold_feed(false) == CncReply::done && !server.paused);
  std::size_t taken = 9;
  CHECK(link.send("G1 ", taken) == CncReply::done && taken == 3 && server.blocks == 0);
  CHECK(link.send("X1\nG0", taken) == CncReply::done && taken == 3 && server.blocks == 1);
  // Somebody else takes control: said once, and not fought over.
  server.control = false;
  CHECK(link.hold_feed(true) == CncReply::reset);
  CHECK(link.connect() == CncReply::reset);
  CHECK(link.connect() == CncReply::done);
}

void improper_servers() {
  using Answer = Server::Answer;
  const std::pair<const char*, Answer> deaf[] = {
      {"silent", [](const std::string&, const std::string&) { return std::string(); }},
      {"hangs up", [](const std::string&, const std::string&) { return std::string("<drop>"); }},
      {"endless", [](const std::string&, const std::string&) { return std::string(100000, 'x'); }},
      {"garbage", [](const std::string&, const std::string&) { return std::string("\x01\xff|"); }}};
  for (const auto& [name, answer] : deaf) {
    Server server(answer);
    LinuxCncLink link(server.config);
    const bool ok =
        link.connect() == CncReply::no_answer && link.hold_feed(true) == CncReply::no_answer;
    check::that(ok, name, __FILE__, __LINE__);
  }
  Server wrong([](const std::string& request, std::string usual) {
    return request.starts_with("hello") ? std::string("HELLO NAK") : usual;
  });
  LinuxCncLink refused(wrong.config);
  CHECK(refused.connect() == CncReply::refused);

  // An interpreter that finds fault, and a machine that is off.
  std::atomic<bool> off{false}, running{false};
  Server faults([&](const std::string& request, std::string usual) -> std::string {
    if (request == "get error") return "ERROR Bad character 'Q' used";
    if (request == "get machine" && off) return "MACHINE OFF";
    if (request == "get mode" && running) return "MODE AUTO";
    if (request == "get program_status" && running) return "PROGRAM_STATUS RUNNING";
    if (request == "get abs_act_pos") return "ABS_ACT_POS nan 0 0";
    return usual;
  });
  LinuxCncLink link(faults.config);
  std::size_t taken = 0;
  CncStatus status;
  CHECK(link.connect() == CncReply::done);
  CHECK(link.send("Q\n", taken) == CncReply::refused && taken == 0);
  CHECK_TEXT(link.complaint(), "Bad character 'Q' used");
  CHECK(link.status(status) == CncReply::no_answer && !status.on);
  running = true;
  CHECK(link.connect() == CncReply::done);
  const int before = faults.blocks;
  CHECK(link.send("G1\n", taken) == CncReply::refused);
  off = true;
  CHECK(link.send("G1\n", taken) == CncReply::refused && faults.blocks == before);

  // A tenth of the replies is lost: the feed hold gets through.
  std::mt19937 random(4);
  Server lossy([&](const std::string&, std::string usual) {
    return random() % 10 == 0 ? std::string() : usual;
  });
  LinuxCncLink poor(lossy.config);
  CncChannel channel(poor);
  for (int i = 0; i < 20; ++i) {
    CHECK(channel.hold_feed());
    CHECK(lossy.paused);
    CHECK(channel.release_feed());
    CHECK(!lossy.paused);
  }
  CHECK(channel.health().no_answer > 0 && lossy.connections > 1);
}

void addresses() {
  const auto plain = linuxcnc_config("linuxcnc://mill");
  CHECK(plain && plain->host == "mill" && plain->port == 5007);
  const auto full = linuxcnc_config("linuxcnc://a:b@10.0.0.7:6000");
  CHECK(full && full->host == "10.0.0.7" && full->port == 6000 && full->connect_password == "a" &&
        full->enable_password == "b");
  for (const char* url : {"", "linuxcnc://", "linuxcnc://:5007", "http://mill", "linuxcnc://mill:0",
                          "linuxcnc://mill:70000", "linuxcnc://a@mill", "linuxcnc://a:@mill",
                          "linuxcnc://mi ll", "linuxcnc://a b:c@mill", "linuxcnc://mill:50x"}) {
    const auto bad = linuxcnc_config(url);
    check::that(!bad && bad.error().kind == ErrorKind::usage, url, __FILE__, __LINE__);
  }
  LinuxCncLink nobody(LinuxCncConfig{.host = "127.0.0.1", .port = 1});
  CHECK(nobody.connect() == CncReply::no_answer);
}

void did(const Expected<Done>& done, int line) {
  check::that(done.has_value(), done ? "done" : done.error().sentence.c_str(), __FILE__, line);
}
#define DID(expression) did(expression, __LINE__)

// Both overrides, there and back, and an operator at the panel.
void overrides_of_the_real_one(LinuxCncLink& link) {
  OverrideRequest request(link);
  const auto serve = [&](double for_s) {
    const Nanoseconds end = link.now_ns() + nanoseconds_from(for_s);
    while (link.now_ns() < end) link.wait(request.turn().value_or(0.05));
  };
  serve(0.3);
  request.set(0.8, 0.75);
  serve(1.5);
  CncOverrides now;
  CHECK(link.overrides(now) == CncReply::done && now.spindle == 0.8 && now.feed == 0.75);
  CHECK(link.set_spindle_override(0.9) == CncReply::done);  // as a panel would
  serve(1);
  CHECK(request.taken_over() && request.health().takeovers == 1);
  request.set(1, 1);
  serve(1.5);
  CHECK(link.overrides(now) == CncReply::done && now.spindle == 0.9 && now.feed == 1);
  CHECK(link.set_spindle_override(1) == CncReply::done);
}

// The same, on a controller that nobody here has written.
void the_real_one(const std::string& url) {
  const auto config = linuxcnc_config(url);
  CHECK(config);
  if (!config) return;
  LinuxCncLink link(*config);
  CncChannel channel(link);
  DID(channel.open());
  const auto begin = channel.status();
  CHECK(begin && begin->on && !begin->moving && begin->feed_override == 1);
  if (!begin) return;
  DID(channel.jog(Channel::x, 50e-6, 1e-3));
  DID(channel.wait_until_there());
  auto now = channel.status();
  CHECK_NEAR(now ? now->position_m[0] - begin->position_m[0] : 0, 50e-6, 1.1e-9);  // six digits
  DID(channel.jog(Channel::z, -8.73e-3, 5e-3));
  DID(channel.wait_until_there());
  now = channel.status();
  CHECK_NEAR(now ? now->position_m[2] - begin->position_m[2] : 0, -8.73e-3, 1.1e-9);
  DID(channel.orient_spindle(kPi / 2));
  DID(channel.turn_spindle(rad_s_from_rpm(1000)));
  DID(channel.turn_spindle(0));
  DID(channel.override_feed(0.5));
  now = channel.status();
  CHECK(now && now->feed_override == 0.5);
  DID(channel.override_feed(1));
  overrides_of_the_real_one(link);
  std::size_t taken = 0;
  CHECK(link.send("G1 X[\n", taken) == CncReply::refused);
  CHECK(!link.complaint().empty());
  std::printf("  LinuxCNC on an open bracket: %s\n", link.complaint().c_str());

  // A feed hold in the middle, once the axis is seen to move, and the rest of the way behind it.
  DID(channel.jog(Channel::y, 10e-3, 1e-3));
  for (int n = 0; n < 100; ++n) {
    const auto to_go = channel.distance_to_go_m();
    if (!to_go || *to_go < 9.9e-3) break;
    link.wait(0.05);
  }
  DID(channel.hold_feed());
  const auto held = channel.status();
  const auto left = channel.distance_to_go_m();
  CHECK(held && held->feed_held && held->moving);
  CHECK(left && *left > 0 && *left < 10e-3);
  link.wait(0.3);
  const auto later = channel.distance_to_go_m();
  CHECK(left && later && *left == *later);
  DID(channel.release_feed());
  DID(channel.wait_until_there());

  // A stop request of its own connection: it takes control, and the channel is told.
  LinuxCncLink second(*config);
  StopRequest request(second);
  DID(channel.jog(Channel::y, -15e-3, 2e-3));
  request.start();
  for (int n = 0; n < 100 && request.health().held == 0; ++n) {
    if (n == 0) request.raise(second.now_ns());
    link.wait(0.05);
  }
  const StopHealth h = request.health();
  CHECK(h.held == 1 && h.tries == 1 && h.events == 1 && h.holding);
  check::figure("ms from alarm to LinuxCNC's acknowledgement",
                1e-6 * static_cast<double>(h.reaction.greatest_ns()), "ms");
  CHECK(!channel.release_feed());  // void: control was taken
  DID(channel.open());
  CHECK(!request.health().released);
  DID(channel.release_feed());
  for (int n = 0; n < 100 && request.health().released == 0; ++n) link.wait(0.05);
  CHECK(request.health().released == 1);
  request.stop();
}

}  // namespace

int main() {
  if (const char* url = std::getenv("SERVOSENSE_LINUXCNC")) {
    the_real_one(url);
    return check::done();
  }
  a_proper_server();
  improper_servers();
  addresses();
  return check::done();
}
