#include "servosense/io/trace.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <istream>
#include <iterator>
#include <limits>

#include "servosense/io/line_reader.hpp"
#include "servosense/io/text.hpp"
#include "trace_time.hpp"

namespace servosense {
namespace {

using detail::append_time;
using detail::kTimeColumn;
using detail::parse_time;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

std::optional<std::string> find_meta(const TraceMetadata& metadata, std::string_view key) {
  for (const auto& [name, value] : metadata)
    if (name == key) return value;
  return std::nullopt;
}

/// The signal a column name stands for, or the sentence that says what is wrong with it.
struct NamedSignal {
  Signal signal;
  std::string fault;
};

NamedSignal signal_from(std::string_view name) {
  if (name.empty())
    return {{}, "expected a column name, found nothing; name the column or remove its comma"};
  const std::size_t dot = name.find('.');
  if (dot == std::string_view::npos)
    return {{},
            "expected <channel>.<quantity>_<unit>, found " + in_quotes(name) +
                "; write it like spindle.current_A"};
  const std::string_view channel_name = name.substr(0, dot);
  const std::string_view quantity_name = name.substr(dot + 1);
  const auto channel = channel_from(channel_name);
  if (!channel)
    return {{},
            "unknown channel " + in_quotes(channel_name) + " in " + in_quotes(name) +
                "; the nearest known one is '" +
                std::string(nearest_name(channel_name, kChannelNames)) + "'"};
  const auto quantity = quantity_from(quantity_name);
  if (!quantity)
    return {{},
            "unknown quantity " + in_quotes(quantity_name) + " in " + in_quotes(name) +
                "; the nearest known one is '" +
                std::string(nearest_name(quantity_name, kQuantityNames)) + "'"};
  return {{*channel, *quantity}, {}};
}

constexpr std::string_view kNotText =
    "the file holds NUL bytes, so it is binary or UTF-16; give comma separated UTF-8 text";

bool holds_nul(std::string_view line) { return line.find('\0') != std::string_view::npos; }

}  // namespace

std::string column_name(Signal signal) {
  return std::string(name_of(signal.channel)) + "." + std::string(name_of(signal.quantity));
}

TraceField TraceField::of(double value) {
  return std::isfinite(value) ? TraceField{State::value, value, 0} : invalid();
}
TraceField TraceField::of_counts(std::int64_t counts) {
  return {State::value, static_cast<double>(counts), counts};
}
TraceField TraceField::invalid() { return {State::invalid, kNaN, 0}; }

// ---------------------------------------------------------------------------------------- reading

constexpr const char* kWorkedOut = "worked out";  // of the metadata

struct TraceReader::Content {
  Content(std::unique_ptr<std::istream> stream, std::string name)
      : lines(std::move(stream), std::move(name)) {}

  LineReader lines;
  std::uint64_t size_bytes = 0;  // 0: unknown
  TraceMetadata metadata;
  std::vector<Signal> signals;
  std::size_t in_file = 0;  // columns; the signals behind them are worked out
  struct Motion {
    std::size_t command, following_error;
  };
  std::vector<Motion> worked_out;
  std::vector<std::string_view> texts;  // fields of the line at hand
  std::optional<Error> failure;
  Nanoseconds last_t_ns = 0;
  std::size_t last_line = 0;   // 0: no row yet
  std::size_t blank_line = 0;  // a blank line that must turn out to be at the end

  /// "FILE:LINE: column 3 (spindle.current_A): what", columns counted from 1, time included.
  [[nodiscard]] Error error_in(std::size_t column, std::string_view what) const {
    const std::string name =
        column == 0 ? std::string(kTimeColumn) : column_name(signals[column - 1]);
    return lines.error_here("column " + std::to_string(column + 1) + " (" + name +
                            "): " + std::string(what));
  }

  void split(std::string_view line) {
    texts.clear();
    for (;;) {
      const std::size_t comma = line.find(',');
      texts.push_back(trim(line.substr(0, comma)));
      if (comma == std::string_view::npos) return;
      line.remove_prefix(comma + 1);
    }
  }

  void read_comment(std::string_view line) {
    const std::string_view text = trim(line.substr(1));
    const std::size_t colon = text.find(':');
    if (colon == std::string_view::npos || colon == 0) return;
    // A blank after the colon tells "key: value" from a clock time or an address.
    if (colon + 1 < text.size() && text[colon + 1] != ' ' && text[colon + 1] != '\t') return;
    metadata.emplace_back(trim(text.substr(0, colon)), trim(text.substr(colon + 1)));
  }

  Expected<Done> read_header();
  Expected<Done> parse_header(std::string_view line);
  void work_out_motion();
  Expected<bool> next(TraceRow& row);
  Expected<bool> parse_row(std::string_view line, TraceRow& row);
  Expected<Done> parse_field(std::size_t column, TraceField& field) const;
};

Expected<Done> TraceReader::Content::read_header() {
  for (;;) {
    std::string_view line;
    const Expected<bool> more = lines.next(line);
    if (!more) return more.error();
    if (!*more)
      return data_error(lines.name() +
                        (lines.line_number() == 0 ? ":1: the file is empty"
                                                  : ":" + std::to_string(lines.line_number()) +
                                                        ": the file ends without a header") +
                        "; its first line must name the columns, like t_s,spindle.current_A");
    if (holds_nul(line) || line.starts_with("\xFF\xFE") || line.starts_with("\xFE\xFF"))
      return lines.error_here(kNotText);
    if (line.starts_with('#'))
      read_comment(line);
    else if (!trim(line).empty())
      return parse_header(line);
  }
}

Expected<Done> TraceReader::Content::parse_header(std::string_view line) {
  split(line);
  if (texts[0] != kTimeColumn) {
    std::string remedy = "the first column is the time in seconds and its name is t_s";
    if (texts[0].starts_with("t_s;") || texts[0].starts_with("t_s\t"))
      remedy = "separate the columns by commas";
    else if (texts[0].starts_with('"'))
      remedy = "write the names without quotation marks";
    else if (parse_number(texts[0]).ok())
      remedy = "put a header above the numbers, like t_s,spindle.current_A";
    return lines.error_here("column 1: expected t_s, found " + in_quotes(texts[0]) + "; " + remedy);
  }
  for (std::size_t i = 1; i < texts.size(); ++i) {
    const NamedSignal named = signal_from(texts[i]);
    const std::string column = "column " + std::to_string(i + 1) + ": ";
    if (!named.fault.empty()) return lines.error_here(column + named.fault);
    const auto twin = std::find(signals.begin(), signals.end(), named.signal);
    if (twin != signals.end())
      return lines.error_here(column + in_quotes(texts[i]) + " stands in column " +
                              std::to_string(twin - signals.begin() + 2) +
                              " already; remove or rename one of them");
    signals.push_back(named.signal);
  }
  in_file = signals.size();
  work_out_motion();
  return Done{};
}

/// A drive whose motion is not there has moved as it was told, less its following error.
void TraceReader::Content::work_out_motion() {
  std::string said;
  const auto at = [&](Channel channel, Quantity quantity) {
    return static_cast<std::size_t>(
        std::find(signals.begin(), signals.end(), Signal{channel, quantity}) - signals.begin());
  };
  for (const Channel channel : kDriveChannels) {
    const bool turns = is_turning(channel);
    const Motion motion{
        at(channel, turns ? Quantity::command_angle_rad : Quantity::command_position_m),
        at(channel, turns ? Quantity::following_error_rad : Quantity::following_error_m)};
    if (std::max(motion.command, motion.following_error) >= signals.size()) continue;
    const Quantity motions[] = {Quantity::angle_counts, Quantity::angle_rad, Quantity::position_m,
                                Quantity::velocity_m_s, Quantity::speed_rad_s};
    if (std::any_of(std::begin(motions), std::end(motions),
                    [&](Quantity q) { return at(channel, q) < signals.size(); }))
      continue;
    signals.push_back({channel, turns ? Quantity::angle_rad : Quantity::position_m});
    worked_out.push_back(motion);
    said += (said.empty() ? "" : ", ") + column_name(signals.back()) + " is " +
            column_name(signals[motion.command]) + " less " +
            column_name(signals[motion.following_error]);
  }
  if (!said.empty()) metadata.emplace_back(kWorkedOut, said);
}

Expected<bool> TraceReader::Content::next(TraceRow& row) {
  for (;;) {
    std::string_view line;
    const Expected<bool> more = lines.next(line);
    if (!more || !*more) return more;
    if (line.starts_with('#')) {
      if (holds_nul(line)) return lines.error_here(kNotText);
      continue;
    }
    if (trim(line).empty()) {
      if (blank_line == 0) blank_line = lines.line_number();
      continue;
    }
    if (blank_line != 0)
      return data_error(lines.name() + ":" + std::to_string(blank_line) + ": expected " +
                        std::to_string(in_file + 1) + " fields, found a blank line; remove it");
    return parse_row(line, row);
  }
}

Expected<bool> TraceReader::Content::parse_row(std::string_view line, TraceRow& row) {
  split(line);
  if (texts.size() != in_file + 1) {
    if (holds_nul(line)) return lines.error_here(kNotText);
    return lines.error_here("expected " + std::to_string(in_file + 1) + " fields, found " +
                            std::to_string(texts.size()) +
                            "; give one field per column of the header (an empty one where no new "
                            "value arrived)");
  }
  const ParsedNumber<Nanoseconds> time = parse_time(texts[0]);
  if (!time.ok()) {
    if (holds_nul(line)) return lines.error_here(kNotText);
    if (time.fault == NumberFault::out_of_range)
      return error_in(0, "time " + in_quotes(texts[0]) +
                             " is beyond the 292 years that nanoseconds can count; write it in "
                             "seconds from a nearer origin");
    return error_in(0, "expected a time in seconds, found " +
                           (texts[0].empty() ? std::string("nothing") : in_quotes(texts[0])) +
                           "; every row needs its own time");
  }
  if (last_line != 0 && time.value <= last_t_ns) {
    std::string last;
    append_time(last, last_t_ns);
    return error_in(0, "time " + in_quotes(texts[0]) + " is not later than " + last +
                           " s of line " + std::to_string(last_line) +
                           "; sort the rows by time and remove repeated ones");
  }
  row.t_ns = time.value;
  row.line = lines.line_number();
  row.fields.resize(signals.size());
  for (std::size_t i = 0; i < in_file; ++i) {
    const Expected<Done> parsed = parse_field(i + 1, row.fields[i]);
    if (!parsed) return holds_nul(line) ? lines.error_here(kNotText) : parsed.error();
  }
  for (std::size_t i = 0; i < worked_out.size(); ++i) {
    using State = TraceField::State;
    const TraceField& told = row.fields[worked_out[i].command];
    const TraceField& behind = row.fields[worked_out[i].following_error];
    row.fields[in_file + i] = told.state == State::invalid || behind.state == State::invalid
                                  ? TraceField::invalid()
                              : told.state == State::empty || behind.state == State::empty
                                  ? TraceField::none()
                                  : TraceField::of(told.value - behind.value);
  }
  last_t_ns = row.t_ns;
  last_line = row.line;
  return true;
}

Expected<Done> TraceReader::Content::parse_field(std::size_t column, TraceField& field) const {
  const std::string_view text = texts[column];
  const bool counts = is_counts(signals[column - 1]);
  if (text.empty()) {
    field = TraceField::none();
    return Done{};
  }
  NumberFault fault = NumberFault::none;
  if (counts) {
    const ParsedNumber<std::int64_t> number = parse_counts(text);
    field = TraceField::of_counts(number.value);
    fault = number.fault;
  } else {
    const ParsedNumber<double> number = parse_number(text);
    field = {TraceField::State::value, number.value, 0};
    fault = number.fault;
  }
  if (fault == NumberFault::none) return Done{};
  if (spells_nan(text)) {
    field = TraceField::invalid();
    return Done{};
  }
  const std::string found = ", found " + in_quotes(text);
  if (fault == NumberFault::infinite)
    return error_in(column,
                    "expected a finite number" + found + "; write nan for an invalid value");
  if (fault == NumberFault::out_of_range)
    return error_in(column, (counts ? "expected a whole number of at most 64 bits"
                                    : "expected a number that a double can hold") +
                                found + "; write nan for an invalid value");
  return error_in(column,
                  (counts ? "expected a whole number of counts" : "expected a number") + found +
                      "; leave the field empty where no new value arrived, write nan for an "
                      "invalid one");
}

TraceReader::TraceReader(std::unique_ptr<Content> content) : content_(std::move(content)) {}
TraceReader::TraceReader(TraceReader&&) noexcept = default;
TraceReader& TraceReader::operator=(TraceReader&&) noexcept = default;
TraceReader::~TraceReader() = default;

Expected<TraceReader> TraceReader::open(const std::string& path) {
  Expected<std::unique_ptr<std::istream>> file = open_for_reading(path);
  if (!file) return file.error();
  Expected<TraceReader> reader = from_stream(std::move(*file), path);
  std::error_code unknown;
  const std::uintmax_t size = std::filesystem::file_size(path, unknown);
  if (reader && !unknown) reader->content_->size_bytes = size;
  return reader;
}

Expected<TraceReader> TraceReader::from_stream(std::unique_ptr<std::istream> stream,
                                               std::string name) {
  auto content = std::make_unique<Content>(std::move(stream), std::move(name));
  const Expected<Done> header = content->read_header();
  if (!header) return header.error();
  return TraceReader(std::move(content));
}

const TraceMetadata& TraceReader::metadata() const { return content_->metadata; }
std::optional<std::string> TraceReader::meta(std::string_view key) const {
  return find_meta(content_->metadata, key);
}
const std::vector<Signal>& TraceReader::signals() const { return content_->signals; }

std::optional<std::size_t> TraceReader::column(Signal signal) const {
  const auto& signals = content_->signals;
  const auto found = std::find(signals.begin(), signals.end(), signal);
  if (found == signals.end()) return std::nullopt;
  return static_cast<std::size_t>(found - signals.begin());
}

Expected<bool> TraceReader::next(TraceRow& row) {
  if (content_->failure) return *content_->failure;
  Expected<bool> result = content_->next(row);
  if (!result) content_->failure = result.error();
  return result;
}

double TraceReader::progress() const {
  if (content_->size_bytes == 0) return 0;
  return std::min(1.0, static_cast<double>(content_->lines.bytes_consumed()) /
                           static_cast<double>(content_->size_bytes));
}

// -------------------------------------------------------------------------------- whole in memory

const std::vector<double>* Trace::find(Signal signal) const {
  const auto found = std::find(signals.begin(), signals.end(), signal);
  return found == signals.end() ? nullptr
                                : &columns[static_cast<std::size_t>(found - signals.begin())];
}

std::optional<std::string> Trace::meta(std::string_view key) const {
  return find_meta(metadata, key);
}

double Trace::sample_rate_hz() const {
  if (t_s.size() < 2) return kNaN;
  std::vector<double> steps(t_s.size() - 1);
  for (std::size_t i = 0; i < steps.size(); ++i) steps[i] = t_s[i + 1] - t_s[i];
  const auto middle = steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2);
  std::nth_element(steps.begin(), middle, steps.end());
  return 1 / *middle;
}

Expected<Trace> read_trace(const std::string& path) {
  Expected<TraceReader> reader = TraceReader::open(path);
  if (!reader) return reader.error();
  return read_trace(*reader);
}

Expected<Trace> read_trace(TraceReader& reader) {
  Trace trace;
  trace.metadata = reader.metadata();
  trace.signals = reader.signals();
  const std::size_t columns = trace.signals.size();
  trace.columns.resize(columns);
  trace.updated.resize(columns);
  trace.counts.resize(columns);
  std::vector<TraceField> held(columns, TraceField::invalid());
  for (TraceRow row;;) {
    const Expected<bool> more = reader.next(row);
    if (!more) return more.error();
    if (!*more) return trace;
    // Division, not a product with 1e-9: the result is then the double nearest to the text.
    trace.t_s.push_back(static_cast<double>(row.t_ns) / 1e9);
    for (std::size_t i = 0; i < columns; ++i) {
      const bool updated = row.fields[i].state != TraceField::State::empty;
      if (updated) held[i] = row.fields[i];
      trace.columns[i].push_back(held[i].value);
      trace.updated[i].push_back(updated);
      if (is_counts(trace.signals[i])) trace.counts[i].push_back(held[i].counts);
    }
  }
}

}  // namespace servosense
