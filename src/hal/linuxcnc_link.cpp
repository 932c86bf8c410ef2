#include "servosense/hal/linuxcnc_link.hpp"

#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#include <cctype>
#include <charconv>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <utility>

#include "servosense/io/text.hpp"

namespace servosense {
namespace {

using Clock = std::chrono::steady_clock;
constexpr std::size_t kLongestReply = 4096;

std::string upper(std::string_view text) {
  std::string out(text);
  for (char& c : out) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
  return out;
}

bool one_word(std::string_view text) {
  for (const char c : text)
    if (static_cast<unsigned char>(c) <= 32) return false;
  return !text.empty();
}

struct AddressDeleter {
  void operator()(addrinfo* a) const noexcept { freeaddrinfo(a); }
};

}  // namespace

Expected<LinuxCncConfig> linuxcnc_config(const std::string& url) {
  constexpr std::string_view kScheme = "linuxcnc://";
  const auto wrong = [&] {
    return usage_error("'" + printable(url) +
                       "' is no address of a CNC; write linuxcnc://HOST:5007 (docs/cnc.md)");
  };
  if (!url.starts_with(kScheme)) return wrong();
  LinuxCncConfig config;
  std::string rest = url.substr(kScheme.size());
  if (const std::size_t at = rest.rfind('@'); at != std::string::npos) {
    const std::string passwords = rest.substr(0, at);
    const std::size_t colon = passwords.find(':');
    if (colon == std::string::npos) return wrong();
    config.connect_password = passwords.substr(0, colon);
    config.enable_password = passwords.substr(colon + 1);
    rest.erase(0, at + 1);
  }
  if (const std::size_t colon = rest.rfind(':'); colon != std::string::npos) {
    unsigned port = 0;
    const char* const end = rest.data() + rest.size();
    const auto read = std::from_chars(rest.data() + colon + 1, end, port);
    if (read.ec != std::errc{} || read.ptr != end || port < 1 || port > 65535) return wrong();
    config.port = static_cast<std::uint16_t>(port);
    rest.resize(colon);
  }
  config.host = rest;
  if (!one_word(config.host) || !one_word(config.connect_password) ||
      !one_word(config.enable_password))
    return wrong();
  return config;
}

struct LinuxCncLink::Content {
  LinuxCncConfig config;
  std::string name;
  std::string complaint;
  int socket = -1;
  bool enabled = false;  // this connection has had control
  std::string input;     // not yet a whole line
  std::string block;     // the same of the NC text

  ~Content() { drop(); }
  void drop() {
    if (socket >= 0) ::close(socket);
    socket = -1;
    input.clear();
    block.clear();
  }
  bool dial() {
    drop();
    addrinfo hints{};
    hints.ai_family = AF_UNSPEC;
    hints.ai_socktype = SOCK_STREAM;
    addrinfo* found = nullptr;
    if (getaddrinfo(config.host.c_str(), std::to_string(config.port).c_str(), &hints, &found) != 0)
      return false;
    const std::unique_ptr<addrinfo, AddressDeleter> addresses(found);
    for (const addrinfo* a = found; a != nullptr; a = a->ai_next) {
      socket = ::socket(a->ai_family, SOCK_STREAM | SOCK_CLOEXEC, 0);
      if (socket < 0) continue;
      // On Linux the sending time limit is that of connecting as well.
      timeval limit{};
      limit.tv_sec = static_cast<time_t>(config.time_limit_s);
      limit.tv_usec =
          static_cast<suseconds_t>(1e6 * (config.time_limit_s - static_cast<double>(limit.tv_sec)));
      setsockopt(socket, SOL_SOCKET, SO_SNDTIMEO, &limit, sizeof limit);
      const int yes = 1;
      setsockopt(socket, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
      if (::connect(socket, a->ai_addr, a->ai_addrlen) == 0) return true;
      drop();
    }
    return false;
  }
  /// The reply to `request`: the first line that begins with `expected`. Without one the connection
  /// is dropped, for a late reply would be taken for that of the next request.
  bool ask(const std::string& request, const std::string& expected, std::string& reply) {
    if (socket < 0) return false;
    const std::string line = request + "\r\n";
    if (::send(socket, line.data(), line.size(), MSG_NOSIGNAL) !=
        static_cast<ssize_t>(line.size())) {
      drop();
      return false;
    }
    const auto end = Clock::now() + std::chrono::duration<double>(config.time_limit_s);
    for (;;) {
      while (next_line(reply)) {
        // Errors are a sentence of LinuxCNC's own: they keep their spelling.
        const std::string shouted = upper(reply);
        if (shouted.starts_with(expected)) {
          reply.erase(0, std::min(reply.size(), expected.size() + 1));
          return true;
        }
      }
      const auto left = std::chrono::duration<double>(end - Clock::now()).count();
      pollfd wanted{socket, POLLIN, 0};
      char bytes[1024];
      ssize_t n = -1;
      if (left > 0 && ::poll(&wanted, 1, static_cast<int>(std::ceil(1000 * left))) > 0)
        n = ::recv(socket, bytes, sizeof bytes, 0);
      if (n <= 0 || input.size() > kLongestReply) {
        drop();
        return false;
      }
      input.append(bytes, static_cast<std::size_t>(n));
    }
  }
  bool next_line(std::string& line) {
    const std::size_t end = input.find_first_of("\r\n");
    if (end == std::string::npos) return false;
    line = input.substr(0, end);
    input.erase(0, end + 1);
    return true;
  }
  bool get(const std::string& what, std::string& value) {
    return ask("get " + what, upper(what), value);
  }
  CncReply set(const std::string& what, const std::string& value) {
    std::string reply;
    if (!ask("set " + what + (value.empty() ? "" : " ") + value, "SET " + upper(what), reply))
      return CncReply::no_answer;
    if (upper(reply) == "ACK") return CncReply::done;
    std::string control;
    if (!get("enable", control)) return CncReply::no_answer;
    return upper(control) == "OFF" ? CncReply::reset : CncReply::refused;
  }
  CncReply mdi(const std::string& text) {
    std::string value;
    if (!get("machine", value)) return CncReply::no_answer;
    if (upper(value) != "ON") return CncReply::refused;
    if (!get("mode", value)) return CncReply::no_answer;
    if (upper(value) != "MDI") {
      // Out of a program that runs, the operator must lead.
      if (!get("program_status", value)) return CncReply::no_answer;
      if (upper(value) != "IDLE") return CncReply::refused;
      if (const CncReply r = set("mode", "mdi"); r != CncReply::done) return r;
    }
    if (!get("error", value)) return CncReply::no_answer;  // of before: reading clears it
    if (const CncReply r = set("mdi", text); r != CncReply::done) return r;
    if (!get("error", value)) return CncReply::no_answer;
    if (upper(value) == "OK") return CncReply::done;
    complaint = printable(value);
    return CncReply::refused;
  }
};

LinuxCncLink::LinuxCncLink(const LinuxCncConfig& config) : content_(std::make_unique<Content>()) {
  content_->config = config;
  content_->name = "LinuxCNC at " + config.host + ':' + std::to_string(config.port);
}
LinuxCncLink::~LinuxCncLink() = default;

const std::string& LinuxCncLink::name() const { return content_->name; }
const std::string& LinuxCncLink::complaint() const { return content_->complaint; }

CncReply LinuxCncLink::connect() {
  Content& c = *content_;
  // A connection that still answers, and that another client has taken control from, was taken
  // over.
  std::string reply;
  if (c.socket >= 0 && c.enabled && c.get("enable", reply) && upper(reply) == "OFF") {
    c.drop();
    return CncReply::reset;
  }
  if (!c.dial()) return CncReply::no_answer;
  if (!c.ask("hello " + c.config.connect_password + " servosense 1.0", "HELLO", reply))
    return CncReply::no_answer;
  if (!upper(reply).starts_with("ACK")) {
    c.drop();
    return CncReply::refused;
  }
  for (const auto& [what, value] : {std::pair<std::string, std::string>{"echo", "off"},
                                    {"verbose", "on"},
                                    {"enable", c.config.enable_password},
                                    {"set_wait", "received"},
                                    {"linear_unit_conversion", "mm"}}) {
    if (what == "echo") {  // not acknowledged, and itself still echoed
      if (!c.ask("set echo off", "SET ECHO", reply)) return CncReply::no_answer;
      continue;
    }
    if (const CncReply r = c.set(what, value); r != CncReply::done)
      return r == CncReply::reset ? CncReply::refused : r;  // a wrong password
  }
  c.enabled = true;
  return CncReply::done;
}

CncReply LinuxCncLink::send(std::string_view text, std::size_t& taken) {
  Content& c = *content_;
  taken = 0;
  const std::size_t end = text.find('\n');
  if (end == std::string_view::npos) {
    c.block += text;
    taken = text.size();
    return CncReply::done;
  }
  const std::string block = std::exchange(c.block, {}) + std::string(text.substr(0, end));
  const CncReply reply = c.mdi(block);
  if (reply == CncReply::done) taken = end + 1;
  return reply;
}

CncReply LinuxCncLink::status(CncStatus& status) {
  Content& c = *content_;
  CncStatus seen;
  std::string estop, machine, program, position, feed;
  if (!c.get("estop", estop) || !c.get("machine", machine) || !c.get("program_status", program) ||
      !c.get("abs_act_pos", position) || !c.get("feed_override", feed))
    return CncReply::no_answer;
  seen.on = upper(estop) == "OFF" && upper(machine) == "ON";
  seen.feed_held = upper(program) == "PAUSED";
  seen.moving = upper(program) != "IDLE";
  seen.feed_override = std::strtod(feed.c_str(), nullptr) / 100;
  const char* at = position.c_str();
  for (double& p : seen.position_m) {
    char* next = nullptr;
    p = std::strtod(at, &next) / 1000;
    if (next == at || !std::isfinite(p)) return CncReply::no_answer;
    at = next;
  }
  status = seen;
  return CncReply::done;
}

CncReply LinuxCncLink::hold_feed(bool hold) { return content_->set(hold ? "pause" : "resume", ""); }

CncReply LinuxCncLink::set_feed_override(double factor) {
  return content_->set("feed_override", std::to_string(std::lround(100 * factor)));
}

CncReply LinuxCncLink::set_spindle_override(double factor) {
  return content_->set("spindle_override", "0 " + std::to_string(std::lround(100 * factor)));
}

CncReply LinuxCncLink::overrides(CncOverrides& overrides) {
  Content& c = *content_;
  std::string feed, spindle;
  // Asked without the number of the spindle, linuxcncrsh 2.9 ends.
  if (!c.get("feed_override", feed) || !c.get("spindle_override 0", spindle))
    return CncReply::no_answer;
  overrides.feed = std::strtod(feed.c_str(), nullptr) / 100;
  overrides.spindle = std::strtod(spindle.c_str(), nullptr) / 100;
  return CncReply::done;
}

}  // namespace servosense
