// What a thread may still do after it has given up its rights, as the kernel tells: by
// /proc/thread-self/status, and by what it refuses.
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <fstream>
#include <string>
#include <thread>

#include "check.hpp"
#include "servosense/hal/privileges.hpp"

using namespace servosense;

namespace {

unsigned long long status(const std::string& name, int base = 16) {
  std::ifstream in("/proc/thread-self/status");
  for (std::string word; in >> word;)
    if (word == name + ':') {
      in >> word;
      return std::stoull(word, nullptr, base);
    }
  check::fail(__FILE__, __LINE__) << "no " << name << " in the kernel's status\n";
  return ~0ULL;
}

// What needs CAP_NET_RAW: 0 or the error.
int raw_socket() {
  const int fd = ::socket(AF_INET, SOCK_RAW, IPPROTO_ICMP);
  if (fd < 0) return errno;
  ::close(fd);
  return 0;
}

void in_a_thread(Privileges kept, unsigned long long most) {
  const unsigned long long had = status("CapPrm");
  unsigned long long permitted = 0, effective = 0, inherited = 0, of_child = 0, no_new = 0;
  int raw = 0;
  bool done = false;
  std::thread thread([&] {
    done = give_up_privileges(kept) && give_up_privileges(kept);
    permitted = status("CapPrm");
    effective = status("CapEff");
    inherited = status("CapInh");
    no_new = status("NoNewPrivs", 10);
    raw = raw_socket();
    std::thread child([&] { of_child = status("CapEff"); });
    child.join();
  });
  thread.join();
  CHECK(done);
  CHECK(permitted == (had & most) && effective == (had & most));
  CHECK(inherited == 0 && no_new == 1 && of_child == effective);
  CHECK(raw == EPERM);
  CHECK(status("CapPrm") == had);  // of this thread
}

}  // namespace

int main() {
  if (status("CapPrm") == 0) std::cout << "  an ordinary user: there is nothing to give up\n";
  // By the kernel's numbers: DAC_OVERRIDE 1, NET_BIND_SERVICE 10, IPC_LOCK 14, SYS_NICE 23.
  in_a_thread(Privileges::of_a_run, 1ULL << 1U | 1ULL << 10U | 1ULL << 14U | 1ULL << 23U);
  in_a_thread(Privileges::none, 0);
  return check::done();
}
