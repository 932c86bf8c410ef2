// Any bytes from a client of the SHDR server, in pieces: each PING is answered once, nothing else
// is, and a client whose line is too long is dropped.
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string>
#include <string_view>

#include "loopback.hpp"
#include "servosense/hal/shdr_server.hpp"

namespace {

constexpr std::size_t kLongestLine = 256;
constexpr std::string_view kBlanks = " \t";

struct Expectation {
  std::size_t pings = 0;
  bool dropped = false;
};

Expectation expectation_of(std::string_view said) {
  Expectation e;
  while (!said.empty() && !e.dropped) {
    const std::size_t end = std::min(said.find('\n'), said.size());
    std::string_view line = said.substr(0, end);
    e.dropped = line.size() > kLongestLine;
    line.remove_prefix(std::min(line.find_first_not_of(kBlanks), line.size()));
    line = line.substr(0, line.find_last_not_of(kBlanks) + 1);
    if (line.ends_with('\r')) line.remove_suffix(1);
    if (line == "* PING") ++e.pings;
    said.remove_prefix(std::min(end + 1, said.size()));
  }
  return e;
}

std::size_t count(std::string_view text, std::string_view word) {
  std::size_t n = 0;
  for (std::size_t at = text.find(word); at != std::string_view::npos; at = text.find(word, at + 1))
    ++n;
  return n;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace servosense;
  static auto server = ShdrServer::open({.port = 0});
  if (!server) std::abort();
  if (size < 1) return 0;
  const int client = ::socket(AF_INET, SOCK_STREAM, 0);
  const linger at_once{1, 0};  // no connection is left waiting
  ::setsockopt(client, SOL_SOCKET, SO_LINGER, &at_once, sizeof at_once);
  const int yes = 1;
  ::setsockopt(client, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
  sockaddr_in address = loopback(server->port());
  auto* const to = reinterpret_cast<sockaddr*>(&address);  // NOLINT: the sockets API
  if (::connect(client, to, sizeof address) != 0) std::abort();

  // The first byte says how long the pieces are; a last PING tells when all is heard.
  std::string said(reinterpret_cast<const char*>(data) + 1, size - 1);  // NOLINT: bytes as text
  said += "\n* PING\n";
  const std::size_t piece = std::size_t{data[0]} * 4 + 1;
  const Expectation expected = expectation_of(said);
  for (std::size_t at = 0; at < said.size(); at += piece)
    if (::send(client, said.data() + at, std::min(piece, said.size() - at), MSG_NOSIGNAL) < 0)
      break;

  std::string heard;
  bool closed = false;
  while (!closed && (expected.dropped || count(heard, "* PONG 10000\n") < expected.pings)) {
    pollfd wait{client, POLLIN, 0};
    if (::poll(&wait, 1, 10000) <= 0) std::abort();  // neither answered nor dropped
    char bytes[4096];
    const ssize_t n = ::recv(client, bytes, sizeof bytes, 0);
    closed = n <= 0;
    if (n > 0) heard.append(bytes, static_cast<std::size_t>(n));
  }
  if (closed != expected.dropped || count(heard, "PONG") > expected.pings) std::abort();
  ::close(client);
  return 0;
}
