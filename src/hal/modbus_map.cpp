#include "servosense/hal/modbus_map.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <sstream>
#include <utility>

#include "map_table.hpp"
#include "modbus_link.hpp"
#include "servosense/io/text.hpp"

namespace servosense {
namespace {

using detail::MapTable;
using detail::parse_period_ns;
using detail::parse_product;
using detail::parse_signal;
using detail::parse_unsigned;

constexpr std::array<std::string_view, 6> kModbusColumns = {"signal", "register", "type",
                                                            "factor", "offset",   "stride"};
constexpr std::array<std::string_view, 5> kModbusSettings = {"period_s", "table", "word_order",
                                                             "buffer_samples", "timeout_s"};

struct TypeName {
  std::string_view name;
  unsigned registers;
  BitField::Kind kind;
};
constexpr std::array<TypeName, 8> kTypes = {{{"int16", 1, BitField::Kind::signed_integer},
                                             {"uint16", 1, BitField::Kind::unsigned_integer},
                                             {"int32", 2, BitField::Kind::signed_integer},
                                             {"uint32", 2, BitField::Kind::unsigned_integer},
                                             {"int64", 4, BitField::Kind::signed_integer},
                                             {"uint64", 4, BitField::Kind::unsigned_integer},
                                             {"float32", 2, BitField::Kind::real},
                                             {"float64", 4, BitField::Kind::real}}};

class ModbusMapParser {
 public:
  explicit ModbusMapParser(MapTable table) : table_(std::move(table)) {}

  Expected<ModbusMap> run() {
    for (const MapTable::Setting& s : table_.settings)
      if (auto done = setting(s); !done) return table_.error_at(s.line, done.error().sentence);
    for (const MapTable::Row& r : table_.rows)
      if (auto done = row(r.cell); !done) return table_.error_at(r.line, done.error().sentence);
    return finish();
  }

 private:
  Expected<Done> setting(const MapTable::Setting& s) {
    auto one_of = [&](std::string_view a, std::string_view b) -> Expected<bool> {
      if (s.value == a) return false;
      if (s.value == b) return true;
      return data_error("expected " + std::string(a) + " or " + std::string(b) + ", found " +
                        in_quotes(s.value));
    };
    if (s.name == "period_s") {
      const auto period = parse_period_ns(s.value);
      if (!period)
        return data_error("expected a period of 1e-6 to 10 s, found " + in_quotes(s.value));
      map_.period_ns = *period;
    } else if (s.name == "table") {
      const auto input = one_of("holding", "input");
      if (!input) return input.error();
      map_.input_registers = *input;
    } else if (s.name == "word_order") {
      const auto little = one_of("big", "little");
      if (!little) return little.error();
      map_.little_words = *little;
    } else if (s.name == "buffer_samples") {
      const auto samples = parse_unsigned(s.value);
      if (!samples || *samples < 2 || *samples > 65536)
        return data_error("expected 2 to 65536 samples, found " + in_quotes(s.value));
      map_.buffer_samples = *samples;
    } else {
      const auto timeout = parse_number(s.value);
      if (!timeout.ok() || !(timeout.value >= 0.001 && timeout.value <= 60))
        return data_error("expected a timeout of 0.001 to 60 s, found " + in_quotes(s.value));
      map_.timeout_s = timeout.value;
    }
    return Done{};
  }

  Expected<Done> row(const std::vector<std::string>& cell) {
    const std::string &signal = cell[0], &address = cell[1], &type = cell[2], &factor = cell[3],
                      &offset = cell[4], &stride = cell[5];
    ModbusField field;
    const bool hexadecimal = address.starts_with("0x");
    const auto at = hexadecimal ? parse_unsigned(std::string_view(address).substr(2), 16)
                                : parse_unsigned(address);
    if (!at || *at > 65535)
      return data_error("expected a register 0 to 65535, found " + in_quotes(address));
    field.address = static_cast<std::uint16_t>(*at);
    const auto known = std::find_if(kTypes.begin(), kTypes.end(),
                                    [&](const TypeName& t) { return t.name == type; });
    if (known == kTypes.end())
      return data_error(
          "expected a type int16, uint16, int32, uint32, int64, uint64, float32 or float64, "
          "found " +
          in_quotes(type));
    field.registers = known->registers;
    field.kind = known->kind;
    if (*at + field.registers > 65536) return data_error("reaches beyond register 65535");
    if (signal == "counter") {
      if (has_counter_) return data_error("a second counter");
      if (field.kind != BitField::Kind::unsigned_integer || field.registers > 2)
        return data_error("expected a counter of type uint16 or uint32, found " + in_quotes(type));
      has_counter_ = true;
      map_.counter = field;
      return Done{};
    }
    const auto wanted = parse_signal(signal, " or 'counter'");
    if (!wanted) return wanted.error();
    if (std::find(map_.signals.begin(), map_.signals.end(), *wanted) != map_.signals.end())
      return data_error("the signal " + in_quotes(signal) + " stands twice");
    if (!factor.empty()) {
      const auto value = parse_product(factor);
      if (!value || *value == 0)
        return data_error("expected a factor such as 0.001*8.5, found " + in_quotes(factor));
      field.factor = *value;
    }
    if (!offset.empty()) {
      const auto value = parse_number(offset);
      if (!value.ok()) return data_error("expected an offset, found " + in_quotes(offset));
      field.offset = value.value;
    }
    if (is_counts(*wanted) &&
        (std::abs(field.factor) != 1 || field.offset != 0 || field.kind == BitField::Kind::real))
      return data_error("counts are whole numbers: no float, no offset, a factor of 1 or -1 only");
    if (!stride.empty()) {
      const auto value = parse_unsigned(stride);
      if (!value || *value < 1 || *value > kMostRegisters)
        return data_error("expected a stride of 1 to 125 registers, found " + in_quotes(stride));
      if (map_.stride != 0 && map_.stride != *value)
        return data_error("records have a stride of " + std::to_string(map_.stride) +
                          " registers elsewhere");
      map_.stride = *value;
    } else if (map_.buffer_samples > 0) {
      return data_error("expected the stride of the records, in registers");
    }
    map_.signals.push_back(*wanted);
    map_.fields.push_back(field);
    return Done{};
  }

  Expected<ModbusMap> finish() {
    auto missing = [&](const std::string& what) { return data_error(table_.name + ": " + what); };
    if (map_.period_ns == 0)
      return missing("the period is missing; write period_s = 0.05, for example");
    if (map_.signals.empty())
      return missing(
          "no signal; the table needs a heading (signal, register, type) and a line for each "
          "signal");
    const unsigned count = map_.register_count();
    if (map_.buffer_samples == 0) {
      if (count > kMostRegisters)
        return missing("the signals lie in " + std::to_string(count) +
                       " registers; one request reads 125 at most");
      return std::move(map_);
    }
    if (!has_counter_)
      return missing("a buffer needs the register of its counter; add a line 'counter, ...'");
    if (map_.counter.registers == 1 && 65536 % map_.buffer_samples != 0)
      return missing(
          "a uint16 counter comes round at 65536: buffer_samples must be a power of two, or the "
          "counter uint32");
    if (count > map_.stride)
      return missing("a record of " + std::to_string(map_.stride) +
                     " registers does not hold signals that lie in " + std::to_string(count));
    if (map_.first_register() + std::uint64_t{map_.stride} * map_.buffer_samples > 65536)
      return missing("the buffer reaches beyond register 65535");
    return std::move(map_);
  }

  MapTable table_;
  ModbusMap map_;
  bool has_counter_ = false;
};

Expected<ModbusMap> map_from(LineReader lines) {
  auto table = MapTable::read(std::move(lines), kModbusColumns, 3, kModbusSettings);
  if (!table) return table.error();
  return ModbusMapParser(std::move(*table)).run();
}

}  // namespace

std::uint16_t ModbusMap::first_register() const {
  std::uint16_t first = 65535;
  for (const ModbusField& f : fields) first = std::min(first, f.address);
  return first;
}

unsigned ModbusMap::register_count() const {
  unsigned end = 0;
  for (const ModbusField& f : fields) end = std::max(end, f.address + f.registers);
  return end - first_register();
}

std::uint64_t raw_words(std::span<const std::uint16_t> words, const ModbusField& field,
                        bool little_words) noexcept {
  std::uint64_t raw = 0;
  for (unsigned i = 0; i < field.registers; ++i)
    raw = raw << 16U | words[little_words ? field.registers - 1 - i : i];
  const unsigned bits = 16 * field.registers;
  if (bits == 0) return 0;
  if (field.kind == BitField::Kind::signed_integer && bits < 64 && (raw >> (bits - 1) & 1U) != 0)
    raw |= ~std::uint64_t{0} << bits;
  return raw;
}

TraceField field_from_words(std::span<const std::uint16_t> words, const ModbusField& field,
                            bool little_words, bool counts) noexcept {
  const std::uint64_t raw = raw_words(words, field, little_words);
  if (counts)
    return TraceField::of_counts(static_cast<std::int64_t>(field.factor < 0 ? 0 - raw : raw));
  const BitField kind{0, 16 * field.registers, field.kind, false};
  return TraceField::of(number_of(raw, kind) * field.factor + field.offset);
}

Expected<ModbusMap> ModbusMap::read(const std::string& path) {
  auto stream = open_for_reading(path);
  if (!stream) return stream.error();
  return map_from(LineReader(std::move(*stream), path));
}

Expected<ModbusMap> ModbusMap::parse(std::string_view text, std::string name) {
  return map_from(
      LineReader(std::make_unique<std::istringstream>(std::string(text)), std::move(name)));
}

}  // namespace servosense
