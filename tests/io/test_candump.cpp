// Candump logs: every form of line that can-utils writes, there and back, and what is refused.
#include <memory>
#include <random>
#include <sstream>

#include "check.hpp"
#include "malformed.hpp"
#include "servosense/io/candump.hpp"

using namespace servosense;

namespace {

CanFrame frame_of(const std::string& line) {
  const auto parsed = parse_candump_line(line);
  CHECK(parsed);
  return parsed ? parsed->frame : CanFrame{};
}

void forms() {
  const CanFrame classic = frame_of("(1436509052.249713) vcan0 044#2A366C2BBA");
  CHECK(classic.t_ns == 1436509052249713000);
  CHECK(classic.id == 0x044 && !classic.extended && !classic.fd && classic.length == 5);
  CHECK(classic.data[0] == 0x2A && classic.data[4] == 0xBA);
  const CanFrame wide = frame_of("(0.5)  can1   1F334455#11.22.33.44.55.66.77.88 T");
  CHECK(wide.t_ns == 500000000 && wide.extended && wide.id == 0x1F334455 && wide.length == 8);
  CHECK(frame_of("(1.000000) can0 00000044#").extended);
  CHECK(frame_of("(1.000000) can0 00000044#").key() != classic.key());
  const CanFrame fd = frame_of("(1.000000001) can0 123##3112233445566778899AABBCC");
  CHECK(fd.t_ns == 1000000001 && fd.fd && fd.bit_rate_switch && fd.error_state_indicator);
  CHECK(fd.length == 12 && fd.data[11] == 0xCC);
  CHECK(frame_of("(1.0) can0 123##5AA").bit_rate_switch);  // the kernel adds bit 4 to received ones
  CHECK(frame_of("(1.0) can0 7FF#R").remote && frame_of("(1.0) can0 7FF#R8").length == 8);
  CHECK(frame_of("(1.0) can0 7FF#R8").bytes().empty());
  const CanFrame error = frame_of("(1.0) can0 20000040#0000000000000000");
  CHECK(error.error && error.id == 0x40 && !error.extended && error.length == 8);
  CHECK(frame_of("(1.0) can0 123#1122334455667788_C").length == 8);
}

// Random frames: what is written reads back as the same frame.
void there_and_back() {
  std::mt19937 random(4021);
  const int lengths[] = {0, 1, 7, 8, 12, 16, 20, 24, 32, 48, 64};
  for (int n = 0; n < 20000; ++n) {
    CanFrame frame;
    frame.t_ns = static_cast<Nanoseconds>(random()) * 997;
    frame.error = random() % 8 == 0;
    frame.extended = !frame.error && random() % 2 == 0;
    frame.id = static_cast<std::uint32_t>(random()) &
               (frame.extended || frame.error ? 0x1FFFFFFFU : 0x7FFU);
    frame.fd = !frame.error && random() % 2 == 0;
    frame.remote = !frame.error && !frame.fd && random() % 4 == 0;
    frame.bit_rate_switch = frame.fd && random() % 2 == 0;
    frame.error_state_indicator = frame.fd && random() % 2 == 0;
    frame.length = static_cast<std::uint8_t>(lengths[random() % (frame.fd ? 11U : 4U)]);
    if (!frame.remote)
      for (unsigned i = 0; i < frame.length; ++i)
        frame.data[i] = static_cast<std::uint8_t>(random());
    const std::string line = candump_line(frame, "vcan0");
    const auto back = parse_candump_line(line);
    if (!back || !(back->frame == frame) || back->interface != "vcan0") {
      check::fail(__FILE__, __LINE__) << "frame " << n << ": " << line << '\n';
      return;
    }
  }
  CHECK_TEXT(candump_line(frame_of("(1436509052.249713) vcan0 044#2A366C2BBA"), "vcan0"),
             "(1436509052.249713) vcan0 044#2A366C2BBA");
}

void refused() {
  malformed::check_all("candump", 19, [](const std::string& path) {
    auto reader = CandumpReader::open(path);
    CanFrame frame;
    while (reader) {
      const auto more = reader->next(frame);
      if (!more) return more.error();
      if (!*more) break;
    }
    return Error{};
  });
}

void reader() {
  auto open = [](const std::string& text, const std::string& interface) {
    return CandumpReader::from_stream(std::make_unique<std::istringstream>(text), "log", interface);
  };
  const std::string text =
      "# two buses\r\n(1.0) can0 100#01\r\n\r\n(1.1) can1 100#02\r\n(1.2) can0 100#03\n";
  CanFrame frame;
  auto all = open(text, "");
  int frames = 0;
  while (*all.next(frame)) ++frames;
  CHECK(frames == 3);
  auto one = open(text, "can0");
  CHECK(*one.next(frame) && frame.data[0] == 1);
  CHECK(*one.next(frame) && frame.data[0] == 3);
  CHECK(!*one.next(frame));
  auto bad = open("(1.0) can0 100#01\n(1.1) can0 10#02\n", "");
  CHECK(*bad.next(frame));
  const auto fault = bad.next(frame);
  CHECK(!fault && fault.error().sentence.rfind("log:2: ", 0) == 0);
  CHECK(!CandumpReader::open("/no/such/log"));
}

}  // namespace

int main() {
  forms();
  there_and_back();
  refused();
  reader();
  return check::done();
}
