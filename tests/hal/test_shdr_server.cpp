// The MTConnect side, as an agent sees it: what is sent, who is answered, who is dropped.
#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <random>
#include <thread>
#include <vector>

#include "check.hpp"
#include "loopback.hpp"
#include "servosense/hal/shdr_server.hpp"

using namespace servosense;

namespace {

constexpr Nanoseconds kTime = 1'772'360'100'250'000'000;

class Agent {
 public:
  explicit Agent(std::uint16_t port, int receive_buffer = 0) {
    socket_ = ::socket(AF_INET, SOCK_STREAM, 0);
    if (receive_buffer > 0)
      setsockopt(socket_, SOL_SOCKET, SO_RCVBUF, &receive_buffer, sizeof receive_buffer);
    sockaddr_in address = loopback(port);
    connected = ::connect(socket_, reinterpret_cast<sockaddr*>(&address), sizeof address) == 0;
  }
  Agent(const Agent&) = delete;
  Agent& operator=(const Agent&) = delete;
  ~Agent() { ::close(socket_); }
  bool say(const std::string& text) {
    return ::send(socket_, text.data(), text.size(), MSG_NOSIGNAL) ==
           static_cast<ssize_t>(text.size());
  }
  // Until `wanted` has been heard, or nothing for a second.
  const std::string& hear(const std::string& wanted) {
    while (heard.find(wanted) == std::string::npos) {
      pollfd p{socket_, POLLIN, 0};
      if (::poll(&p, 1, 1000) <= 0) break;
      char bytes[4096];
      const ssize_t n = ::recv(socket_, bytes, sizeof bytes, 0);
      if (n <= 0) {
        dropped = true;
        break;
      }
      heard.append(bytes, static_cast<std::size_t>(n));
    }
    return heard;
  }
  bool heard_of(const std::string& wanted) {
    return hear(wanted).find(wanted) != std::string::npos;
  }
  bool connected = false;
  bool dropped = false;
  std::string heard;

 private:
  int socket_ = -1;
};

void an_agent_is_served() {
  auto server = ShdrServer::open({.port = 0});
  CHECK(server);
  if (!server) return;
  server->value(kTime, "spindle_torque", 4.25);
  server->condition(kTime, "chatter_spindle", "NORMAL", "armed", "watching");
  server->value(kTime + 1'000'000, "spindle_torque", 4.5);
  Agent agent(server->port());
  CHECK(agent.connected);
  // The present values, not the past ones.
  CHECK(agent.heard_of("2026-03-01T10:15:00.251000Z|spindle_torque|4.5\n"));
  CHECK(agent.heard_of("2026-03-01T10:15:00.250000Z|chatter_spindle|NORMAL|armed|||watching\n"));
  CHECK(agent.heard.find("|4.25\n") == std::string::npos);
  CHECK(agent.heard.starts_with("* shdrVersion: 2.0\n"));
  // Then the changes, to everybody.
  Agent second(server->port());
  CHECK(second.heard_of("spindle_torque|4.5\n"));
  server->condition(kTime, "chatter_spindle", "FAULT", "alarm", "strong | vibration\nhere");
  CHECK(agent.heard_of("|chatter_spindle|FAULT|alarm|||strong   vibration here\n"));
  CHECK(second.heard_of("|chatter_spindle|FAULT|alarm|||strong   vibration here\n"));
  server->value(kTime, "x_force", std::nan(""));
  CHECK(agent.heard_of("|x_force|UNAVAILABLE\n"));
  // PING, in pieces and with both line ends.
  CHECK(agent.say("* PI"));
  CHECK(agent.say("NG\n"));
  CHECK(agent.heard_of("* PONG 10000\n"));
  CHECK(second.say("hello\r\n* PING\r\n"));
  CHECK(second.heard_of("* PONG 10000\n"));
  CHECK(server->health().connected == 2);
}

void others_are_not() {
  auto server = ShdrServer::open({.port = 0, .most_clients = 3, .most_unread_bytes = 20000});
  CHECK(server);
  if (!server) return;
  Agent good(server->port());
  CHECK(good.heard_of("servosense\n"));
  {
    Agent rude(server->port());
    rude.say(std::string(300, 'x'));
    rude.hear("never");
    CHECK(rude.dropped);
    Agent slow(server->port(), 1024);
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    // More than the sockets' own buffers hold.
    for (int i = 0; i < 200000 && server->health().dropped_slow == 0; ++i) {
      server->value(kTime, "x_force", i);
      if (i % 100 == 99) good.heard.clear(), good.hear("|" + std::to_string(i) + "\n");
    }
    CHECK(server->health().dropped_slow == 1);
    CHECK(server->health().dropped_rude == 1);
    CHECK(!good.dropped);
    Agent third(server->port()), fourth(server->port()), fifth(server->port());
    fifth.hear("never");
    CHECK(fifth.dropped);
    CHECK(server->health().refused >= 1);
  }
  // Whoever goes may come back.
  std::this_thread::sleep_for(std::chrono::milliseconds(50));
  Agent again(server->port());
  CHECK(again.heard_of("x_force"));
  server->value(kTime, "last", 1);
  CHECK(good.heard_of("|last|1\n"));
}

// Places taken by clients that say nothing are not lost: the one that has been silent for longest
// makes room. One that asks for its heartbeat stays.
void idle_ones_go() {
  auto server = ShdrServer::open({.port = 0, .most_clients = 3, .heartbeat_ms = 50});
  CHECK(server);
  if (!server) return;
  server->value(kTime, "x_force", 1);
  Agent good(server->port());
  CHECK(good.heard_of("x_force"));
  Agent silent(server->port());
  CHECK(silent.heard_of("x_force"));
  Agent quiet(server->port());
  CHECK(quiet.heard_of("x_force"));
  std::this_thread::sleep_for(std::chrono::milliseconds(110));  // two heartbeats
  CHECK(good.say("* PING\n") && good.heard_of("* PONG 50\n"));
  Agent later(server->port());
  CHECK(later.heard_of("x_force"));
  silent.hear("never");
  CHECK(silent.dropped && !good.dropped);
  CHECK(server->health().dropped_idle == 1);
  Agent last(server->port());
  CHECK(last.heard_of("x_force"));
  quiet.hear("never");
  CHECK(quiet.dropped && server->health().dropped_idle == 2);
  CHECK(good.say("* PING\n"));
  server->value(kTime, "last", 1);
  CHECK(good.heard_of("|last|1\n"));
}

// Any bytes, in any pieces: the server lives on.
void noise() {
  auto server = ShdrServer::open({.port = 0});
  CHECK(server);
  if (!server) return;
  std::mt19937 random(3);
  for (int i = 0; i < 50; ++i) {
    Agent agent(server->port());
    std::string bytes;
    for (auto n = random() % 600; n > 0; --n)
      bytes += static_cast<char>(random() % 16 == 0 ? '\n' : random());
    agent.say(bytes);
  }
  Agent agent(server->port());
  CHECK(agent.say("* PING\n") && agent.heard_of("* PONG"));
}

// Only this computer is served unless told otherwise, as the kernel lists it: 0100007F is
// 127.0.0.1, 0A is listening.
void on_loopback_alone() {
  const auto listening = [](std::uint16_t port) {
    char wanted[16];
    std::snprintf(wanted, sizeof wanted, ":%04X", port);
    std::ifstream in("/proc/net/tcp");
    std::string all;
    for (std::string number, local, remote, state, rest;
         in >> number >> local >> remote >> state;) {
      std::getline(in, rest);
      if (local.ends_with(wanted) && state == "0A") all += local.substr(0, 8) + ' ';
    }
    return all;
  };
  auto server = ShdrServer::open({.port = 0});
  auto open = ShdrServer::open({.port = 0, .address = "0.0.0.0"});
  CHECK(server && open);
  if (!server || !open) return;
  CHECK_TEXT(listening(server->port()), "0100007F ");
  CHECK_TEXT(listening(open->port()), "00000000 ");
}

// The thread that hears strangers has no rights, whatever the program was started with.
void without_rights() {
  auto server = ShdrServer::open({.port = 0});
  CHECK(server);
  if (!server) return;
  Agent agent(server->port());
  CHECK(agent.heard_of("servosense\n"));  // it runs
  int lines = 0;
  for (const auto& task : std::filesystem::directory_iterator("/proc/self/task")) {
    std::ifstream in(task.path() / "status");
    std::string line;
    if (!std::getline(in, line) || line != "Name:\tshdr") continue;
    while (std::getline(in, line))
      if (line.starts_with("CapEff:") || line.starts_with("CapPrm:")) {
        CHECK_TEXT(line.substr(8), "0000000000000000");
        ++lines;
      }
  }
  CHECK(lines == 2);
}

void refused() {
  auto server = ShdrServer::open({.port = 0});
  CHECK(server);
  if (!server) return;
  const auto taken = ShdrServer::open({.port = server->port()});
  CHECK(!taken && taken.error().kind == ErrorKind::device);
  const auto nowhere = ShdrServer::open({.port = 0, .address = "here"});
  CHECK(!nowhere && nowhere.error().kind == ErrorKind::usage);
  CHECK_TEXT(shdr_time(0), "1970-01-01T00:00:00.000000Z");
  CHECK_TEXT(shdr_time(-1), "1969-12-31T23:59:59.999999Z");
}

}  // namespace

int main() {
  an_agent_is_served();
  others_are_not();
  idle_ones_go();
  noise();
  on_loopback_alone();
  without_rights();
  refused();
  return check::done();
}
