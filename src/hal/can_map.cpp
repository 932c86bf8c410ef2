#include "servosense/hal/can_map.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>
#include <sstream>
#include <utility>

#include "map_table.hpp"
#include "servosense/io/line_reader.hpp"
#include "servosense/io/text.hpp"
#include "servosense/io/unit_name.hpp"

namespace servosense {
namespace {

using detail::MapTable;
using detail::parse_period_ns;
using detail::parse_product;
using detail::parse_signal;
using detail::parse_unsigned;
using ReadDbc = std::function<Expected<Dbc>(const std::string&)>;

constexpr std::array<std::string_view, 10> kColumns = {
    "signal", "frame", "byte", "type", "factor", "offset", "samples", "stride", "every", "dbc"};
constexpr std::array<std::string_view, 4> kSettings = {"period_s", "sync", "heartbeat", "dbc"};
constexpr std::size_t kMostMessages = 1024;
// Half a second at 8 kHz. The aligner keeps a few times as many rows per drive.
constexpr unsigned kMostPeriods = 4096;

// 0x181, 385, 0x00000181 (29 bits), 0x18FF1234.
std::optional<std::uint32_t> parse_identifier(std::string_view text) {
  const bool hexadecimal = text.starts_with("0x") || text.starts_with("0X");
  const std::string_view digits = hexadecimal ? text.substr(2) : text;
  const auto id = parse_unsigned(digits, hexadecimal ? 16 : 10);
  if (!id || *id > 0x1FFFFFFF) return std::nullopt;
  CanFrame frame;
  frame.id = *id;
  frame.extended = *id > 0x7FF || (hexadecimal && digits.size() > 3);
  return frame.key();
}

std::optional<BitField> parse_type(std::string_view text, unsigned start_bit) {
  BitField field;
  field.start_bit = start_bit;
  if (text.ends_with("be")) {
    field.big_endian = true;
    text.remove_suffix(2);
  }
  if (text.starts_with("float")) {
    field.kind = BitField::Kind::real;
    text.remove_prefix(5);
  } else if (text.starts_with("uint")) {
    text.remove_prefix(4);
  } else if (text.starts_with("int")) {
    field.kind = BitField::Kind::signed_integer;
    text.remove_prefix(3);
  } else {
    return std::nullopt;
  }
  const auto bits = parse_unsigned(text);
  if (!bits || *bits < 1 || *bits > 64) return std::nullopt;
  if (field.kind == BitField::Kind::real && *bits != 32 && *bits != 64) return std::nullopt;
  if (field.big_endian && (*bits % 8 != 0 || start_bit % 8 != 0)) return std::nullopt;
  field.bits = *bits;
  return field;
}

class MapParser {
 public:
  explicit MapParser(MapTable table) : table_(std::move(table)) {}

  Expected<CanMap> run(const ReadDbc& read_dbc) {
    for (const MapTable::Setting& s : table_.settings) {
      if (s.name == "dbc") {
        auto dbc = read_dbc(s.value);
        if (!dbc) return dbc.error();
        dbc_ = std::move(*dbc);
      } else if (auto done = setting(s); !done) {
        return table_.error_at(s.line, done.error().sentence);
      }
    }
    for (const MapTable::Row& r : table_.rows)
      if (auto done = row(r.cell); !done) return table_.error_at(r.line, done.error().sentence);
    return finish();
  }

 private:
  static Error error(const std::string& what) { return data_error(what); }

  Expected<Done> setting(const MapTable::Setting& s) {
    if (s.name == "period_s") {
      const auto period = parse_period_ns(s.value);
      if (!period)
        return error("expected a servo period of 1e-6 to 10 s, found " + in_quotes(s.value));
      map_.period_ns = *period;
    } else if (s.name == "sync") {
      map_.sync_key = parse_identifier(s.value);
      if (!map_.sync_key)
        return error("expected an identifier such as 0x080, found " + in_quotes(s.value));
    } else {
      std::istringstream words(s.value);
      for (std::string word; words >> word;) {
        const auto key = parse_identifier(word);
        if (!key) return error("expected identifiers such as 0x701, found " + in_quotes(word));
        map_.heartbeat_keys.push_back(*key);
      }
    }
    return Done{};
  }

  // Where a number is: by frame, byte and type, or by its name in the DBC file.
  Expected<Dbc::Found> place(const std::vector<std::string>& cell) const {
    const std::string &frame = cell[1], &byte = cell[2], &type = cell[3], &dbc = cell[9];
    if (!dbc.empty()) {
      if (!frame.empty() || !byte.empty() || !type.empty())
        return error("give either frame, byte and type, or dbc");
      if (!dbc_)
        return error("no DBC file is named; write above the table, for example, dbc = drives.dbc");
      return dbc_->find(dbc);
    }
    const auto key = parse_identifier(frame);
    if (!key) return error("expected an identifier such as 0x181, found " + in_quotes(frame));
    const std::size_t dot = byte.find('.');
    const auto first = parse_unsigned(std::string_view(byte).substr(0, dot));
    const auto bit = dot == std::string::npos
                         ? std::optional<std::uint32_t>(0)
                         : parse_unsigned(std::string_view(byte).substr(dot + 1));
    if (!first || !bit || *first >= CanFrame::kMaxBytes || *bit > 7)
      return error("expected a byte 0 to 63, or byte.bit, found " + in_quotes(byte));
    const auto field = parse_type(type, *first * 8 + *bit);
    if (!field)
      return error(
          "expected a type intN, uintN, float32 or float64, big-endian ones (be) in whole "
          "bytes, found " +
          in_quotes(type));
    Dbc::Found found;
    found.key = *key;
    found.signal.bits = *field;
    return found;
  }

  Expected<Done> row(const std::vector<std::string>& cell) {
    const std::string &signal = cell[0], &type = cell[3], &samples = cell[6], &stride = cell[7],
                      &every = cell[8], &dbc = cell[9];
    const auto found = place(cell);
    if (!found) return found.error();
    const BitField& field = found->signal.bits;
    const auto& multiplexing = found->signal.multiplexing;
    if (multiplexing && every.empty())
      return error(in_quotes(dbc) +
                   " is multiplexed; say with 'every' how many servo periods pass from one frame "
                   "that carries it to the next");

    MapMessage& message = message_for(found->key, multiplexing);
    if (map_.messages.size() > kMostMessages) return error("more than 1024 different frames");
    if (auto done = block(message, samples, stride, every); !done) return done;
    const unsigned stride_bits = stride.empty() ? 0 : 8 * parse_unsigned(stride).value_or(0);
    if (field.start_bit + field.bits + stride_bits * (message.samples - 1) >
        8 * CanFrame::kMaxBytes)
      return error("reaches beyond the 64 bytes of a frame");

    if (signal == "sequence") {
      if (message.sequence) return error("a second sequence in this frame");
      if (field.kind != BitField::Kind::unsigned_integer || field.bits > 32)
        return error("expected a sequence of type uint1 to uint32, found " +
                     in_quotes(dbc.empty() ? type : dbc));
      message.sequence = field;
      return Done{};
    }
    return add_signal(message, signal, found->signal, stride_bits, cell);
  }

  Expected<Done> add_signal(MapMessage& message, std::string_view signal, const DbcSignal& source,
                            unsigned stride_bits, const std::vector<std::string>& cell) {
    const std::string &factor = cell[4], &offset = cell[5], &dbc = cell[9];
    const std::size_t dot = signal.find('.');
    if (dot != std::string_view::npos && channel_from(signal.substr(0, dot)) &&
        signal.substr(dot + 1) == "status_word") {
      if (message.status_word) return error("a second status word in this frame");
      message.status_word = source.bits;
      return Done{};
    }
    const auto wanted = parse_signal(signal, ", 'sequence' or CHANNEL.status_word");
    if (!wanted) return wanted.error();
    double unit = 1, zero = 0;
    if (!factor.empty()) {
      const auto value = parse_product(factor);
      if (!value || *value == 0)
        return error("expected a factor such as 0.001*8.5, found " + in_quotes(factor));
      unit = *value;
    } else if (!dbc.empty() && !is_counts(*wanted)) {
      const auto value = value_of_unit(source.unit, wanted->quantity);
      const auto named = [](std::string_view text) {
        return text.empty() ? "no unit" : in_quotes(text);
      };
      if (!value)
        return error(in_quotes(dbc) + " is in " + named(source.unit) + ", " + std::string(signal) +
                     " in " + named(unit_of(wanted->quantity)) +
                     "; write in the column 'factor' what one of the former is in the latter");
      unit = *value;
    }
    if (!offset.empty()) {
      const auto value = parse_number(offset);
      if (!value.ok()) return error("expected an offset, found " + in_quotes(offset));
      zero = value.value;
    }
    const MapField entry{map_.signals.size(), source.bits, stride_bits, source.factor * unit,
                         source.offset * unit + zero};
    if (is_counts(*wanted) && (std::abs(entry.factor) != 1 || entry.offset != 0 ||
                               source.bits.kind == BitField::Kind::real))
      return error("counts are whole numbers: no float, no offset, a factor of 1 or -1 only");
    if (std::find(map_.signals.begin(), map_.signals.end(), *wanted) != map_.signals.end())
      return error("the signal " + in_quotes(signal) + " stands twice");
    map_.signals.push_back(*wanted);
    message.fields.push_back(entry);
    return Done{};
  }

  // Rows of one frame must agree about its block.
  Expected<Done> block(MapMessage& message, std::string_view samples, std::string_view stride,
                       std::string_view every) {
    unsigned count = 1;
    if (!samples.empty()) {
      const auto value = parse_unsigned(samples);
      if (!value || *value < 1 || *value > 64)
        return error("expected 1 to 64 samples, found " + in_quotes(samples));
      count = *value;
    }
    if (count > 1) {
      const auto bytes = parse_unsigned(stride);
      if (!bytes || *bytes < 1 || *bytes > CanFrame::kMaxBytes)
        return error("expected the stride of a block in bytes, found " + in_quotes(stride));
      if (message.samples != 1 && message.samples != count)
        return error("this frame has blocks of " + std::to_string(message.samples) +
                     " samples elsewhere");
      message.samples = count;
      message.every = std::max(message.every, count);
    }
    if (!every.empty()) {
      const auto value = parse_unsigned(every);
      if (!value || *value < message.samples || *value > kMostPeriods)
        return error(
            "expected a whole number of servo periods, not fewer than samples and at most " +
            std::to_string(kMostPeriods) + ", found " + in_quotes(every));
      message.every = *value;
    }
    return Done{};
  }

  MapMessage& message_for(std::uint32_t key, const std::optional<Multiplexing>& multiplexing) {
    for (MapMessage& m : map_.messages)
      if (m.key == key && m.multiplexing == multiplexing) return m;
    map_.messages.push_back({});
    map_.messages.back().key = key;
    map_.messages.back().multiplexing = multiplexing;
    return map_.messages.back();
  }

  Expected<CanMap> finish() {
    if (map_.period_ns == 0)
      return data_error(table_.name +
                        ": the servo period is missing; write period_s = 0.000125, for example");
    if (map_.signals.empty())
      return data_error(table_.name +
                        ": no signal; the table needs a heading (signal, frame, byte, type) and a "
                        "line for each signal");
    for (const MapMessage& m : map_.messages)
      if (m.samples > 1)
        for (const MapField& f : m.fields)
          if (f.stride_bits == 0)
            return data_error(table_.name + ": " + column_name(map_.signals[f.column]) +
                              " is a single number in a frame of " + std::to_string(m.samples) +
                              " samples; give it samples and stride as well");
    sort_by_message();
    return std::move(map_);
  }

  // Columns of one frame stand side by side in a row.
  void sort_by_message() {
    std::vector<Signal> sorted;
    for (MapMessage& m : map_.messages)
      for (MapField& f : m.fields) {
        sorted.push_back(map_.signals[f.column]);
        f.column = sorted.size() - 1;
      }
    map_.signals = std::move(sorted);
  }

  MapTable table_;
  std::optional<Dbc> dbc_;
  CanMap map_;
};

Expected<CanMap> map_from(LineReader lines, const ReadDbc& read_dbc) {
  auto table = MapTable::read(std::move(lines), kColumns, 4, kSettings, "dbc");
  if (!table) return table.error();
  return MapParser(std::move(*table)).run(read_dbc);
}

}  // namespace

TraceField read_field(const CanFrame& frame, const MapField& field, unsigned sample,
                      bool counts) noexcept {
  BitField at = field.bits;
  at.start_bit += sample * field.stride_bits;
  const auto raw = raw_bits(frame.bytes(), at);
  if (!raw) return TraceField::invalid();
  if (counts) {
    const auto value = static_cast<std::int64_t>(field.factor < 0 ? 0 - *raw : *raw);
    return TraceField::of_counts(value);
  }
  return TraceField::of(number_of(*raw, at) * field.factor + field.offset);
}

std::string_view cia402_state(std::uint16_t status_word) noexcept {
  switch (status_word & 0x4FU) {
    case 0x00:
      return "not ready to switch on";
    case 0x40:
      return "switch on disabled";
    case 0x0F:
      return "fault reaction active";
    case 0x08:
      return "fault";
    default:
      break;
  }
  switch (status_word & 0x6FU) {
    case 0x21:
      return "ready to switch on";
    case 0x23:
      return "switched on";
    case 0x27:
      return "operation enabled";
    case 0x07:
      return "quick stop active";
    default:
      return "unknown";
  }
}

Expected<CanMap> CanMap::read(const std::string& path) {
  auto stream = open_for_reading(path);
  if (!stream) return stream.error();
  return map_from(LineReader(std::move(*stream), path), [&](const std::string& dbc) {
    return Dbc::read((std::filesystem::path(path).parent_path() / dbc).string());
  });
}

Expected<CanMap> CanMap::parse(std::string_view text, std::string name, std::string_view dbc) {
  return map_from(
      LineReader(std::make_unique<std::istringstream>(std::string(text)), std::move(name)),
      [&](const std::string& file) { return Dbc::parse(dbc, file); });
}

}  // namespace servosense
