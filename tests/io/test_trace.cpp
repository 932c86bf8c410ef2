// Trace files: format, errors, exact round trips, constant memory.
#include <sys/resource.h>

#include <bit>
#include <cstring>
#include <limits>
#include <random>
#include <sstream>

#include "check.hpp"
#include "malformed.hpp"
#include "sanitized.hpp"
#include "servosense/io/line_reader.hpp"
#include "servosense/io/trace.hpp"

using namespace servosense;

namespace {

constexpr Signal kCurrent{Channel::spindle, Quantity::current_A};
constexpr Signal kCounts{Channel::x, Quantity::angle_counts};
constexpr Signal kForce{Channel::y, Quantity::force_N};
using State = TraceField::State;

Expected<TraceReader> reader_of(std::string text) {
  return TraceReader::from_stream(std::make_unique<std::istringstream>(std::move(text)), "memory");
}

Expected<Trace> trace_of(std::string text) {
  Expected<TraceReader> reader = reader_of(std::move(text));
  if (!reader) return reader.error();
  return read_trace(*reader);
}

std::string sentence_of(std::string text) {
  const Expected<Trace> trace = trace_of(std::move(text));
  return trace ? "" : trace.error().sentence;
}

void test_format() {
  const std::string text =
      "# machine: bench 3\n# start: 2024-05-01 12:30\n#no metadata\n# see http://host\n\n"
      "t_s, spindle.current_A ,x.angle_counts\n"
      "-0.5,1.5,7\n"
      "# a remark in the middle\n"
      "0,,-9223372036854775808\n"
      "1e-3,nan,\n"
      "0.002 ,\t+2.5e-1,18446744073709551615\n\n\n";
  std::string crlf = "\xEF\xBB\xBF";
  for (const char c : text) crlf += c == '\n' ? "\r\n" : std::string(1, c);
  std::string unfinished = text.substr(0, text.size() - 3);

  for (const std::string& form : {text, crlf, unfinished}) {
    Expected<TraceReader> reader = reader_of(form);
    CHECK(reader.has_value());
    if (!reader) continue;
    CHECK(reader->metadata().size() == 2);
    CHECK_TEXT(reader->meta("machine").value_or(""), "bench 3");
    CHECK_TEXT(reader->meta("start").value_or(""), "2024-05-01 12:30");
    CHECK(!reader->meta("stop"));
    CHECK(reader->signals() == (std::vector<Signal>{kCurrent, kCounts}));
    CHECK(reader->column(kCounts) == 1U);
    CHECK(!reader->column(kForce));

    TraceRow row;
    CHECK(*reader->next(row));
    CHECK(row.t_ns == -500'000'000 && row.line == 7);
    CHECK(row.fields[0].state == State::value && row.fields[0].value == 1.5);
    CHECK(row.fields[1].counts == 7 && row.fields[1].value == 7);
    CHECK(*reader->next(row));
    CHECK(row.t_ns == 0 && row.line == 9);
    CHECK(row.fields[0].state == State::empty);
    CHECK(row.fields[1].counts == std::numeric_limits<std::int64_t>::min());
    CHECK(*reader->next(row));
    CHECK(row.t_ns == 1'000'000);
    CHECK(row.fields[0].state == State::invalid && std::isnan(row.fields[0].value));
    CHECK(row.fields[1].state == State::empty);
    CHECK(*reader->next(row));
    CHECK(row.t_ns == 2'000'000 && row.fields[0].value == 0.25);
    // Upper half of an unsigned counter: two's complement, so that the next difference is exact.
    CHECK(row.fields[1].counts == -1);
    const Expected<bool> end = reader->next(row);
    CHECK(end && !*end);
  }
}

void test_time_digits() {
  // Nanoseconds by hand; a double holds 16 digits, these have up to 19.
  const auto t = [](const std::string& digits) {
    Expected<TraceReader> reader = reader_of("t_s\n" + digits + "\n");
    TraceRow row;
    const Expected<bool> more = reader->next(row);
    return more && *more ? row.t_ns : std::numeric_limits<Nanoseconds>::min();
  };
  CHECK(t("1700000000.123456789") == 1'700'000'000'123'456'789);
  CHECK(t("9223372036.854775807") == std::numeric_limits<Nanoseconds>::max());
  CHECK(t("0.0000000005") == 1);
  CHECK(t("0.00000000049999999999999999999999") == 0);
  CHECK(t("-0.0000000015") == -2);
  CHECK(t("1.25e2") == 125'000'000'000);
  CHECK(t("12500000000000000000000e-20") == 125'000'000'000);
  CHECK(t("0.000000000000001E+15") == 1'000'000'000);
  CHECK(t("5e-10") == 1);
  CHECK(t("4e-10") == 0);
  CHECK(t("1e-99999999999999999999") == 0);
  CHECK(t("0e99999999999999999999") == 0);
  CHECK(t(".5") == 500'000'000);
  CHECK(t("5.") == 5'000'000'000);
  for (const char* bad : {"9223372036.8547758075", "1e10", "1e99999999999999999999", "-1e300"})
    CHECK(sentence_of(std::string("t_s\n") + bad + "\n").find("292 years") != std::string::npos);
  for (const char* bad : {".", "-", "e5", "1e", "1e+", "1.2.3", "--1", "1 2", "0x1p3", "1e2.5"})
    CHECK(sentence_of(std::string("t_s\n") + bad + "\n").find("expected a time") !=
          std::string::npos);
}

void test_errors() {
  malformed::check_all("trace", 30, [](const std::string& path) {
    const Expected<Trace> trace = read_trace(path);
    return trace ? Error{} : trace.error();
  });

  // A line over 1 MiB: in the header, and in a row.
  const std::string longest(LineReader::kLongestLine, '1');
  CHECK_TEXT(sentence_of("t_s\n0\n" + longest + "1\n"),
             "memory:3: the line is longer than 1 MiB; give a text file with one record a line");
  CHECK(sentence_of("# " + longest).starts_with("memory:1: the line is longer"));
  CHECK(sentence_of("t_s\n" + longest + "\n").find("292 years") != std::string::npos);

  // The reader repeats its error rather than going on behind it.
  Expected<TraceReader> reader = reader_of("t_s\n0\nx\n1\n");
  TraceRow row;
  CHECK(*reader->next(row));
  const Expected<bool> first = reader->next(row);
  const Expected<bool> second = reader->next(row);
  CHECK(!first && !second);
  CHECK_TEXT(first.error().sentence, second.error().sentence);

  for (const char* path : {"tests/data", "tests/data/malformed/trace/absent.csv"}) {
    const Expected<Trace> trace = read_trace(path);
    CHECK(!trace && trace.error().kind == ErrorKind::device);
    CHECK(trace.error().sentence.starts_with(path));
  }

  // Controls in a field must not break the sentence's line or the terminal.
  const std::string odd = sentence_of("t_s,x.force_N\n0,a\x1b[2J\r\xff\n");
  CHECK(odd.find("'a\\x1b[2J\\x0d\\xff'") != std::string::npos);
}

/// Random bit patterns: every finite double is as likely as any other.
double any_double(std::mt19937_64& random) {
  for (;;) {
    const auto value = std::bit_cast<double>(random());
    if (std::isfinite(value)) return value;
  }
}

void test_round_trip() {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    std::mt19937_64 random(seed);
    const std::vector<Signal> signals = {kForce, kCounts, kCurrent};
    const TraceMetadata metadata = {{"machine", "M: 3"}, {"note", ""}};
    std::ostringstream text;
    Expected<TraceWriter> writer = TraceWriter::to_stream(text, "memory", signals, metadata);
    CHECK(writer.has_value());
    std::vector<TraceRow> rows(500);
    auto t = static_cast<Nanoseconds>(random() >> 8U) - (Nanoseconds{1} << 55U);
    bool all_written = true;
    for (TraceRow& row : rows) {
      t += 1 + static_cast<Nanoseconds>(random() >> (random() % 50 + 14));
      row.t_ns = t;
      for (const Signal signal : signals) {
        const std::uint64_t choice = random() % 10;
        row.fields.push_back(choice == 0   ? TraceField::none()
                             : choice == 1 ? TraceField::invalid()
                             : is_counts(signal)
                                 ? TraceField::of_counts(static_cast<std::int64_t>(random()))
                                 : TraceField::of(any_double(random)));
      }
      all_written = all_written && writer->write(row.t_ns, row.fields);
    }
    CHECK(all_written && writer->close());

    Expected<TraceReader> reader = reader_of(text.str());
    CHECK(reader && reader->metadata() == metadata && reader->signals() == signals);
    bool same = reader.has_value();
    TraceRow copy;
    for (std::size_t i = 0; same && i < rows.size(); ++i) {
      const Expected<bool> more = reader->next(copy);
      same = more && *more && copy.t_ns == rows[i].t_ns;
      for (std::size_t k = 0; same && k < signals.size(); ++k) {
        const TraceField& a = rows[i].fields[k];
        const TraceField& b = copy.fields[k];
        same = a.state == b.state && a.counts == b.counts &&
               (a.state == State::invalid ||
                std::bit_cast<std::uint64_t>(a.value) == std::bit_cast<std::uint64_t>(b.value));
      }
    }
    ++check::checks;
    if (!same) check::fail(__FILE__, __LINE__) << "round trip, seed " << seed << '\n';
  }
}

void test_writer() {
  std::ostringstream text;
  Expected<TraceWriter> writer =
      TraceWriter::to_stream(text, "out.csv", {kCurrent, kCounts}, {{"machine", "M"}});
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double infinite = std::numeric_limits<double>::infinity();
  CHECK(writer->write(-1, std::vector<double>{0.1, 3}));
  CHECK(writer->write(1'500'000'000, std::vector<double>{nan, -2e15}));
  CHECK(writer->write(2'000'000'000, std::vector<double>{-infinite, nan}));

  const auto refused = [&](Nanoseconds t_ns, const std::vector<double>& values, const char* why) {
    const Expected<Done> written = writer->write(t_ns, values);
    CHECK(!written && written.error().kind == ErrorKind::usage);
    CHECK(!written && written.error().sentence.find(why) != std::string::npos);
  };
  refused(2'000'000'000, {1, 1}, "not later");
  refused(3'000'000'000, {1}, "expected 2 fields, got 1");
  refused(3'000'000'000, {1, 0.5}, "x.angle_counts: expected whole counts");
  refused(3'000'000'000, {1, 0x1p63}, "whole counts");
  CHECK(writer->close());
  CHECK(writer->close());
  refused(4'000'000'000, {1, 1}, "closed");
  CHECK_TEXT(text.str(),
             "# machine: M\nt_s,spindle.current_A,x.angle_counts\n-0.000000001,0.1,3\n"
             "1.5,nan,-2000000000000000\n2,nan,nan\n");

  CHECK(!TraceWriter::to_stream(text, "o", {kForce, kForce}));
  CHECK(!TraceWriter::to_stream(text, "o", {}, {{"a:b", "c"}}));
  CHECK(!TraceWriter::to_stream(text, "o", {}, {{"a", "b\nt_s"}}));
  const Expected<TraceWriter> nowhere = TraceWriter::create("tests/absent/out.csv", {kForce});
  CHECK(!nowhere && nowhere.error().kind == ErrorKind::device);
  if (std::ifstream("/dev/full")) {  // a disk without room
    Expected<TraceWriter> full = TraceWriter::create("/dev/full", {kForce});
    CHECK(full && full->write(0, std::vector<double>{1}));
    const Expected<Done> closed = full->close();
    CHECK(!closed && closed.error().kind == ErrorKind::device);
    CHECK(!closed && closed.error().sentence.find("No space left") != std::string::npos);
    CHECK(!full->close());
  }
}

void test_whole() {
  const Expected<Trace> trace = trace_of(
      "# k: v\nt_s,x.angle_counts,y.force_N\n0,,\n0.001,9007199254740993,1\n0.002,,\n0.003,nan,2\n"
      "0.005,5,nan\n1.0,,\n");
  CHECK(trace.has_value());
  if (!trace) return;
  CHECK(trace->size() == 6);
  CHECK(trace->t_s[3] == 0.003);  // the double nearest to the text
  CHECK_TEXT(trace->meta("k").value_or(""), "v");
  const std::vector<double>& force = *trace->find(kForce);
  CHECK(std::isnan(force[0]) && force[1] == 1 && force[2] == 1 && force[3] == 2);
  CHECK(std::isnan(force[4]) && std::isnan(force[5]));
  CHECK(trace->updated[1] == (std::vector<bool>{false, true, false, true, true, false}));
  CHECK(trace->updated[0] == (std::vector<bool>{false, true, false, true, true, false}));
  // 2^53 + 1 has no double.
  CHECK(trace->counts[0] ==
        (std::vector<std::int64_t>{0, 9007199254740993, 9007199254740993, 0, 5, 5}));
  CHECK(trace->counts[1].empty());
  CHECK(trace->find(kCurrent) == nullptr);
  CHECK_NEAR(trace->sample_rate_hz(), 1000, 1e-9);  // rounding of 1 ms steps of t < 1: 1e-13 of 1
  CHECK(std::isnan(trace_of("t_s\n0\n")->sample_rate_hz()));
  CHECK(trace_of("t_s,x.force_N\n")->size() == 0);
}

/// A trace of any length that is made while it is read.
class EndlessTrace : public std::streambuf {
 public:
  explicit EndlessTrace(std::uint64_t bytes) : left_(bytes) {
    block_ = "t_s,spindle.angle_counts,spindle.current_A,x.position_m,x.current_A\n";
    setg(block_.data(), block_.data(), block_.data() + block_.size());
  }

 protected:
  int_type underflow() override {
    if (left_ == 0) return traits_type::eof();
    block_.clear();
    for (int i = 0; i < 500; ++i) {
      ++rows_;
      block_ += std::to_string(rows_ / 8000) + "." +
                std::to_string(1'000'000 + rows_ % 8000 * 125).substr(1) + "," +
                std::to_string(rows_ * 37) + ",1.234567,0.0123456789,-3.25\n";
    }
    left_ -= std::min<std::uint64_t>(left_, block_.size());
    setg(block_.data(), block_.data(), block_.data() + block_.size());
    return traits_type::to_int_type(block_[0]);
  }

 private:
  std::uint64_t left_;
  std::uint64_t rows_ = 0;
  std::string block_;
};

class EndlessStream : public std::istream {
 public:
  explicit EndlessStream(std::uint64_t bytes) : std::istream(nullptr), buffer_(bytes) {
    rdbuf(&buffer_);
  }

 private:
  EndlessTrace buffer_;
};

void test_constant_memory() {
  const auto peak_MB = [] {
    rusage usage{};
    getrusage(RUSAGE_SELF, &usage);
    return static_cast<double>(usage.ru_maxrss) / 1024;
  };
  const auto drain = [](std::uint64_t bytes) {
    Expected<TraceReader> reader =
        TraceReader::from_stream(std::make_unique<EndlessStream>(bytes), "made");
    std::uint64_t rows = 0;
    std::int64_t last = 0;
    for (TraceRow row;;) {
      const Expected<bool> more = reader->next(row);
      if (!more || !*more) {
        CHECK(more.has_value());
        break;
      }
      ++rows;
      last = row.fields[0].counts;
    }
    CHECK(last == static_cast<std::int64_t>(rows) * 37);
    return rows;
  };
  const std::uint64_t short_rows = drain(30'000'000);
  const double before = peak_MB();
  const std::uint64_t long_rows = drain(300'000'000);
  CHECK(long_rows > 9 * short_rows);
  check::figure("peak memory added by a trace ten times as long (300 MB)", peak_MB() - before,
                "MB");
  if (!kSanitized) CHECK_BETWEEN(peak_MB() - before, 0, 10);
}

void test_progress() {
  const std::string path = "tests/data/malformed/trace/not_a_number.csv";
  Expected<TraceReader> reader = TraceReader::open(path);
  TraceRow row;
  CHECK(*reader->next(row));
  // Header (37 bytes) and first row (6) of the file's 60.
  CHECK_NEAR(reader->progress(), 43.0 / static_cast<double>(std::filesystem::file_size(path)),
             1e-12);
}

}  // namespace

int main() {
  test_format();
  test_time_digits();
  test_errors();
  test_round_trip();
  test_writer();
  test_whole();
  test_progress();
  test_constant_memory();
  return check::done();
}
