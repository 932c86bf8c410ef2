// Modbus against a slave of our own that is not libmodbus: polls with every kind of fault, and a
// buffer that a drive fills at 8 kHz while it is read.
#include <cmath>
#include <cstring>
#include <random>
#include <vector>

#include "check.hpp"
#include "io/malformed.hpp"
#include "modbus_server.hpp"
#include "servosense/hal/modbus_rows.hpp"

using namespace servosense;
using namespace std::chrono_literals;

namespace {

constexpr const char* kPolled = R"(period_s = 0.0002
timeout_s = 0.08
signal,               register, type,   factor
spindle.angle_counts, 100,      uint32
spindle.current_A,    102,      int16,  0.001*8
x.position_m,         103,      float32
)";

// Word i of the registers from 100 on holds a number that tells poll and place: the three signals
// agree with one another, or the answer was put together wrongly.
std::vector<std::uint16_t> agreeing(unsigned poll, unsigned first, unsigned count) {
  const auto value = static_cast<float>(poll);
  std::uint32_t bits = 0;
  std::memcpy(&bits, &value, 4);
  const std::uint16_t all[] = {
      static_cast<std::uint16_t>(poll >> 16U), static_cast<std::uint16_t>(poll),
      static_cast<std::uint16_t>(poll % 30000), static_cast<std::uint16_t>(bits >> 16U),
      static_cast<std::uint16_t>(bits)};
  std::vector<std::uint16_t> words;
  for (unsigned i = 0; i < count; ++i)
    words.push_back(first + i - 100 < 5 ? all[first + i - 100] : 0);
  return words;
}

std::unique_ptr<ModbusRows> open(const std::string& url, const std::string& text,
                                 const std::atomic<bool>& stop) {
  auto map = ModbusMap::parse(text, "map");
  if (!map) {
    check::fail(__FILE__, __LINE__) << map.error().sentence << '\n';
    return nullptr;
  }
  auto rows = ModbusRows::open(url, std::move(*map), stop);
  if (!rows) {
    check::fail(__FILE__, __LINE__) << rows.error().sentence << '\n';
    return nullptr;
  }
  return std::move(*rows);
}

void polls(bool tcp, unsigned count) {
  std::mt19937 random(tcp ? 5 : 6);
  std::atomic<unsigned> made[6] = {};
  std::atomic<unsigned> poll{0};
  std::atomic<bool> stop{false};
  ModbusServer server(
      tcp, [&](unsigned first, unsigned n) { return agreeing(++poll, first, n); },
      [&](unsigned n) {
        if (n < 20 || random() % 100 != 0) return Misbehaviour::none;
        auto kind = static_cast<Misbehaviour>(1 + random() % 5);
        if (!tcp && kind == Misbehaviour::disconnect) kind = Misbehaviour::exception;
        ++made[static_cast<int>(kind)];
        return kind;
      });
  const auto rows = open(server.url(), kPolled, stop);
  if (!rows) return;
  TraceRow row;
  unsigned good = 0, invalid = 0, quiet = 0;
  bool right = true;
  Nanoseconds last = 0;
  while (good + invalid < count) {
    const auto more = rows->next(row);
    CHECK(more && *more);
    if (!more || !*more) break;
    if (row.fields.empty()) {
      ++quiet;
      continue;
    }
    right = right && row.t_ns > last;
    last = row.t_ns;
    if (row.fields[0].state == TraceField::State::invalid) {
      ++invalid;
      continue;
    }
    ++good;
    const std::int64_t number = row.fields[0].counts;
    right = right && row.fields[1].value == static_cast<double>(number % 30000) * (0.001 * 8) &&
            row.fields[2].value == static_cast<double>(static_cast<float>(number));
  }
  CHECK(right);
  const ModbusHealth& h = rows->health();
  const unsigned faults = made[1] + made[2] + made[3] + made[4] + made[5];
  std::printf("  %s: %u polls, %u faults made, %u rows invalid, %llu connections\n",
              tcp ? "TCP" : "RTU", count, faults, invalid,
              static_cast<unsigned long long>(h.connections));
  CHECK(faults > count / 200);
  // Nothing is lost unflagged: every fault is a row of invalid values, and no other row is.
  CHECK(invalid == faults);
  CHECK(h.exceptions == made[1]);
  CHECK(h.timeouts + h.garbage == faults - made[1]);
  CHECK(h.answered == good);
}

// A drive that takes 8000 samples a second: its ring is read in bursts, while faults fall on it.
constexpr const char* kBuffered = R"(period_s = 0.000125
buffer_samples = 2048
timeout_s = 0.05
word_order = little
signal,               register, type,  factor, offset, stride
counter,              1000,     uint32
spindle.angle_counts, 2000,     int32, ,       ,       3
spindle.current_A,    2002,     int16, 0.5,    ,       3
)";

class Drive {
 public:
  std::vector<std::uint16_t> operator()(unsigned first, unsigned count) {
    const auto now =
        static_cast<std::uint64_t>(
            std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count() *
            8000) +
        100000;
    std::vector<std::uint16_t> words;
    for (unsigned i = first; i < first + count; ++i) {
      if (i == 1000 || i == 1001) {
        words.push_back(static_cast<std::uint16_t>(now >> (i == 1000 ? 0U : 16U)));
        continue;
      }
      const std::uint64_t slot = (i - 2000) / 3;
      std::uint64_t n = now - 1 - (now - 1 - slot) % 2048;  // newest sample in this slot
      const auto value = static_cast<std::uint32_t>(n * 7);
      const unsigned word = (i - 2000) % 3;
      words.push_back(word == 0   ? static_cast<std::uint16_t>(value)
                      : word == 1 ? static_cast<std::uint16_t>(value >> 16U)
                                  : static_cast<std::uint16_t>(n % 10000));
    }
    return words;
  }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

void bursts(unsigned fault_every, std::size_t count) {
  std::atomic<bool> stop{false};
  Drive drive;
  ModbusServer server(
      true, [&](unsigned first, unsigned n) { return drive(first, n); },
      [&](unsigned n) {
        if (fault_every == 0 || n % fault_every != fault_every - 1) return Misbehaviour::none;
        return static_cast<Misbehaviour>(1 + n / fault_every % 4);
      });
  const auto rows = open(server.url(), kBuffered, stop);
  if (!rows) return;
  TraceRow row;
  std::size_t n = 0;
  bool right = true;
  Nanoseconds first_t = 0, last_t = 0;
  std::int64_t first = 0;
  std::uint64_t holes = 0;
  while (n < count) {
    const auto more = rows->next(row);
    if (!more || !*more) break;
    if (row.fields.empty()) continue;
    const std::int64_t number = row.fields[0].counts / 7;
    if (n == 0) {
      first = number;
      first_t = row.t_ns;
    } else {
      holes += static_cast<std::uint64_t>((row.t_ns - last_t) / 125000 - 1);
    }
    last_t = row.t_ns;
    right = right && row.fields[0].counts % 7 == 0 &&
            row.t_ns - first_t == (number - first) * 125000 &&
            row.fields[1].value == 0.5 * static_cast<double>(number % 10000);
    ++n;
  }
  CHECK(right);  // every sample is where the drive's counter says
  CHECK(n == count);
  CHECK(holes == rows->health().overwritten);
  std::printf("  buffer: %zu samples, %llu overwritten, %llu requests, %llu connections\n", n,
              static_cast<unsigned long long>(holes),
              static_cast<unsigned long long>(rows->health().requests),
              static_cast<unsigned long long>(rows->health().connections));
  if (fault_every == 0)
    CHECK(rows->health().exceptions + rows->health().timeouts + rows->health().garbage == 0);
}

void silence_and_stop() {
  std::atomic<bool> stop{false};
  std::atomic<bool> dead{false};
  ModbusServer server(
      true, [&](unsigned first, unsigned n) { return agreeing(1, first, n); },
      [&](unsigned) { return dead ? Misbehaviour::silent : Misbehaviour::none; });
  const auto rows = open(server.url(), kPolled, stop);
  if (!rows) return;
  TraceRow row;
  CHECK(*rows->next(row) && row.fields[0].state == TraceField::State::value);
  dead = true;
  bool invalid = false;
  for (int i = 0; i < 3 && !invalid; ++i)
    invalid = *rows->next(row) && !row.fields.empty() &&
              row.fields[0].state == TraceField::State::invalid;
  CHECK(invalid);
  dead = false;
  bool back = false;  // within a second and a timeout
  for (int i = 0; i < 10 && !back; ++i)
    back =
        *rows->next(row) && !row.fields.empty() && row.fields[0].state == TraceField::State::value;
  CHECK(back);
  stop = true;
  for (int i = 0; i < 3; ++i)
    if (!*rows->next(row)) break;
  CHECK(!*rows->next(row));
}

void addresses() {
  const std::atomic<bool> stop{false};
  const auto map = ModbusMap::parse(kPolled, "map");
  CHECK(map);
  if (!map) return;
  for (const char* url :
       {"", "tcp://", "tcp://:502", "tcp://host:0", "tcp://host:70000", "tcp://host/256",
        "http://host", "rtu:", "rtu:/dev/x?baud=1", "rtu:/dev/x?parity=X", "rtu:/dev/x?what=1"}) {
    const auto rows = ModbusRows::open(url, *map, stop);
    CHECK(!rows && rows.error().kind == ErrorKind::usage);
  }
  for (const char* url : {"tcp://127.0.0.1:1/1", "rtu:/no/such/device?baud=9600&parity=E&unit=7"}) {
    const auto rows = ModbusRows::open(url, *map, stop);
    CHECK(!rows && rows.error().kind == ErrorKind::device);
    CHECK(!rows && rows.error().sentence.find("check the address") != std::string::npos);
  }
}

void maps() {
  const auto map = ModbusMap::parse(kBuffered, "map");
  CHECK(map && map->little_words && map->buffer_samples == 2048 && map->stride == 3);
  malformed::check_all("modbus_map", 16, [](const std::string& path) {
    const auto bad = ModbusMap::read(path);
    return bad ? Error{} : bad.error();
  });
  const std::pair<const char*, const char*> whole[] = {
      {"", "the period is missing"},
      {"period_s = 1\n", "no signal"},
      {"period_s = 1\nsignal, register, type\nx.force_N, 0, int16\ny.force_N, 125, int16\n",
       "125 at most"},
      {"period_s = 1\nbuffer_samples = 8\nsignal, register, type, stride\nx.force_N, 0, int16, 1\n",
       "its counter"},
      {"period_s = 1\nbuffer_samples = 9\nsignal, register, type, stride\ncounter, 9, "
       "uint16\nx.force_N, 0, int16, 1\n",
       "power of two"},
      {"period_s = 1\nbuffer_samples = 8\nsignal, register, type, stride\ncounter, 9, "
       "uint16\nx.force_N, 0, int32, 1\n",
       "does not hold"},
      {"period_s = 1\nbuffer_samples = 8\nsignal, register, type, stride\ncounter, 9, "
       "uint16\nx.force_N, 65530, int16, 1\n",
       "beyond register 65535"}};
  for (const auto& [text, fragment] : whole) {
    const auto bad = ModbusMap::parse(text, "map");
    CHECK(!bad && bad.error().sentence.starts_with("map: "));
    CHECK(!bad && bad.error().sentence.find(fragment) != std::string::npos);
  }
}

// Numbers of one, two and four registers, either word first, with their sign.
void numbers() {
  const std::vector<std::uint16_t> words = {0xFFFE, 0x1234, 0x5678, 0x9ABC};
  const auto read = [&](unsigned registers, BitField::Kind kind, bool little_words) {
    return raw_words(words, {0, registers, kind, 1, 0}, little_words);
  };
  constexpr auto kSigned = BitField::Kind::signed_integer;
  constexpr auto kUnsigned = BitField::Kind::unsigned_integer;
  CHECK(read(1, kSigned, false) == 0xFFFFFFFFFFFFFFFEU && read(1, kUnsigned, false) == 0xFFFEU);
  CHECK(read(2, kSigned, false) == 0xFFFFFFFFFFFE1234U && read(2, kSigned, true) == 0x1234FFFEU);
  CHECK(read(4, kSigned, false) == 0xFFFE123456789ABCU);
  CHECK(read(4, kSigned, true) == 0x9ABC56781234FFFEU);
  CHECK(read(4, kUnsigned, false) == 0xFFFE123456789ABCU);
}

}  // namespace

int main() {
  maps();
  numbers();
  addresses();
  polls(true, 10000);
  polls(false, 1500);
  bursts(0, 12000);
  bursts(40, 12000);
  silence_and_stop();
  return check::done();
}
