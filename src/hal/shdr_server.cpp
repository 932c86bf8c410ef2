#include "servosense/hal/shdr_server.hpp"

#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <map>
#include <mutex>
#include <thread>
#include <utility>
#include <vector>

#include "servosense/hal/privileges.hpp"
#include "servosense/io/text.hpp"

namespace servosense {
namespace {

constexpr std::size_t kLongestInput = 256;  // a client has nothing to say but PING

class FileDescriptor {
 public:
  explicit FileDescriptor(int fd = -1) : fd_(fd) {}
  FileDescriptor(FileDescriptor&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  FileDescriptor& operator=(FileDescriptor&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
  }
  ~FileDescriptor() {
    if (fd_ >= 0) ::close(fd_);
  }
  [[nodiscard]] int get() const { return fd_; }

 private:
  int fd_;
};

using Clock = std::chrono::steady_clock;

struct Client {
  FileDescriptor socket;
  Clock::time_point heard = Clock::now();
  std::string input;
  std::string output;
};

}  // namespace

std::string shdr_time(Nanoseconds t_ns) {
  Nanoseconds second = t_ns / kNanosecondsPerSecond;
  Nanoseconds rest = t_ns % kNanosecondsPerSecond;
  if (rest < 0) {
    rest += kNanosecondsPerSecond;
    --second;
  }
  const auto time = static_cast<time_t>(second);
  tm utc{};
  gmtime_r(&time, &utc);
  char text[64];
  const std::size_t n = std::strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%S", &utc);
  std::snprintf(text + n, sizeof text - n, ".%06lldZ", static_cast<long long>(rest / 1000));
  return text;
}

std::string shdr_text(std::string_view text) {
  std::string out(text);
  for (char& c : out)
    if (c == '|' || static_cast<unsigned char>(c) < 32) c = ' ';
  return out;
}

struct ShdrServer::Content {
  ShdrConfig config;
  FileDescriptor listener, wake;
  std::uint16_t port = 0;
  std::thread thread;
  std::atomic<bool> stop{false};

  mutable std::mutex mutex;                                 // of what follows
  std::string fresh;                                        // lines that no client has yet
  bool overflowed = false;                                  // some were left out of it
  std::map<std::string, std::string, std::less<>> present;  // newest line of every item
  ShdrHealth health;

  std::vector<Client> clients;  // the thread's own

  ~Content() {
    stop = true;
    signal();
    if (thread.joinable()) thread.join();
  }
  void signal() const {
    const std::uint64_t one = 1;
    [[maybe_unused]] const ssize_t n = ::write(wake.get(), &one, sizeof one);
  }
  void say(std::string_view item, std::string line) {
    const std::lock_guard lock(mutex);
    if (fresh.size() < config.most_unread_bytes)
      fresh += line;
    else
      overflowed = true;  // then the present values must do
    present.insert_or_assign(std::string(item), std::move(line));
    signal();
  }

  void run() {
    prctl(PR_SET_NAME, "shdr");            // for ps and top
    give_up_privileges(Privileges::none);  // it reads what strangers write
    std::vector<pollfd> polled;
    while (!stop) {
      polled.assign({{listener.get(), POLLIN, 0}, {wake.get(), POLLIN, 0}});
      for (const Client& c : clients)
        polled.push_back(
            {c.socket.get(), static_cast<short>(c.output.empty() ? POLLIN : POLLIN | POLLOUT), 0});
      if (::poll(polled.data(), polled.size(), 1000) < 0 && errno != EINTR) return;
      if (stop) return;
      if ((polled[1].revents & POLLIN) != 0) take_fresh();
      std::vector<Client> kept;
      for (std::size_t i = 0; i < clients.size(); ++i)
        if (serve(clients[i], polled[i + 2].revents)) kept.push_back(std::move(clients[i]));
      clients = std::move(kept);
      if ((polled[0].revents & POLLIN) != 0) accept_one();
    }
  }
  void take_fresh() {
    std::uint64_t count = 0;
    [[maybe_unused]] const ssize_t n = ::read(wake.get(), &count, sizeof count);
    std::string lines;
    {
      const std::lock_guard lock(mutex);
      lines.swap(fresh);
      if (std::exchange(overflowed, false)) {
        lines.clear();
        for (const auto& [item, line] : present) lines += line;
      }
    }
    for (Client& c : clients) c.output += lines;
  }
  void accept_one() {
    FileDescriptor socket(
        ::accept4(listener.get(), nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC));
    if (socket.get() < 0) return;
    const int yes = 1;  // an alarm does not wait for the last value to be acknowledged
    setsockopt(socket.get(), IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
    const std::lock_guard lock(mutex);
    if (clients.size() >= config.most_clients && !drop_idle()) {
      ++health.refused;
      return;
    }
    ++health.connected;
    Client client;
    client.socket = std::move(socket);
    client.output = "* shdrVersion: 2.0\n* adapterVersion: servosense\n";
    for (const auto& [item, line] : present) client.output += line;
    clients.push_back(std::move(client));
  }
  bool drop_idle() {
    const auto oldest =
        std::min_element(clients.begin(), clients.end(),
                         [](const Client& a, const Client& b) { return a.heard < b.heard; });
    const auto silence = 2 * std::chrono::milliseconds(config.heartbeat_ms);
    if (oldest == clients.end() || Clock::now() - oldest->heard < silence) return false;
    clients.erase(oldest);
    ++health.dropped_idle;
    return true;
  }
  void count(std::uint64_t ShdrHealth::*counter) {
    const std::lock_guard lock(mutex);
    ++(health.*counter);
  }
  // False when the client is to be dropped.
  bool serve(Client& c, short events) {
    if ((events & (POLLERR | POLLNVAL)) != 0) return false;
    if ((events & (POLLIN | POLLHUP)) != 0) {
      char bytes[512];
      const ssize_t n = ::recv(c.socket.get(), bytes, sizeof bytes, 0);
      if (n == 0 || (n < 0 && errno != EAGAIN && errno != EINTR)) return false;
      if (n > 0) c.heard = Clock::now();
      if (n > 0 && !hear(c, {bytes, static_cast<std::size_t>(n)})) {
        count(&ShdrHealth::dropped_rude);
        return false;
      }
    }
    if (!c.output.empty()) {
      const ssize_t n = ::send(c.socket.get(), c.output.data(), c.output.size(), MSG_NOSIGNAL);
      if (n > 0) c.output.erase(0, static_cast<std::size_t>(n));
      if (n < 0 && errno != EAGAIN && errno != EINTR) return false;
    }
    if (c.output.size() > config.most_unread_bytes) {
      count(&ShdrHealth::dropped_slow);
      return false;
    }
    return true;
  }
  bool hear(Client& c, std::string_view bytes) const {
    c.input += bytes;
    for (;;) {
      const std::size_t end = c.input.find('\n');
      if (end == std::string::npos) return c.input.size() <= kLongestInput;
      if (end > kLongestInput) return false;
      if (trim(std::string_view(c.input).substr(0, end)) == "* PING" ||
          trim(std::string_view(c.input).substr(0, end)) == "* PING\r")
        c.output += "* PONG " + std::to_string(config.heartbeat_ms) + '\n';
      c.input.erase(0, end + 1);
    }
  }
};

ShdrServer::ShdrServer(std::unique_ptr<Content> content) : content_(std::move(content)) {}
ShdrServer::ShdrServer(ShdrServer&&) noexcept = default;
ShdrServer& ShdrServer::operator=(ShdrServer&&) noexcept = default;
ShdrServer::~ShdrServer() = default;

Expected<ShdrServer> ShdrServer::open(const ShdrConfig& config) {
  auto content = std::make_unique<Content>();
  content->config = config;
  const std::string where = config.address + ':' + std::to_string(config.port);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(config.port);
  if (inet_pton(AF_INET, config.address.c_str(), &address.sin_addr) != 1)
    return usage_error("'" + printable(config.address) + "' is no IPv4 address such as 127.0.0.1");
  content->listener =
      FileDescriptor(::socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
  content->wake = FileDescriptor(eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC));
  const int yes = 1;
  socklen_t size = sizeof address;
  setsockopt(content->listener.get(), SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
  if (content->listener.get() < 0 || content->wake.get() < 0 ||
      bind(content->listener.get(), reinterpret_cast<sockaddr*>(&address), size) != 0 ||  // NOLINT
      listen(content->listener.get(), 8) != 0 ||
      getsockname(content->listener.get(), reinterpret_cast<sockaddr*>(&address), &size) !=
          0)  // NOLINT
    return device_error(where + " cannot be listened on: " + std::strerror(errno) +
                        (errno == EADDRNOTAVAIL ? "; give an address of this computer"
                         : errno == EACCES      ? "; choose a port of 1024 or more"
                                                : "; choose another port"));
  content->port = ntohs(address.sin_port);
  Content* const running = content.get();
  content->thread = std::thread([running] { running->run(); });
  return ShdrServer(std::move(content));
}

std::uint16_t ShdrServer::port() const { return content_->port; }

ShdrHealth ShdrServer::health() const {
  const std::lock_guard lock(content_->mutex);
  return content_->health;
}

void ShdrServer::value(Nanoseconds t_ns, std::string_view item, double value) {
  std::string line = shdr_time(t_ns) + '|' + std::string(item) + '|';
  char number[32];
  std::snprintf(number, sizeof number, "%.6g", value);
  line += std::isfinite(value) ? number : "UNAVAILABLE";
  content_->say(item, line + '\n');
}

void ShdrServer::text(Nanoseconds t_ns, std::string_view item, std::string_view value) {
  content_->say(item, shdr_time(t_ns) + '|' + std::string(item) + '|' + shdr_text(value) + '\n');
}

void ShdrServer::condition(Nanoseconds t_ns, std::string_view item, std::string_view level,
                           std::string_view native_code, std::string_view text) {
  content_->say(item, shdr_time(t_ns) + '|' + std::string(item) + '|' + std::string(level) + '|' +
                          shdr_text(native_code) + "|||" + shdr_text(text) + '\n');
}

}  // namespace servosense
