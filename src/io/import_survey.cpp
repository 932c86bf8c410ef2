#include "import_survey.hpp"

#include <algorithm>
#include <cmath>

#include "servosense/io/text.hpp"

namespace servosense::detail {
namespace {

constexpr double kNoValue = std::numeric_limits<double>::quiet_NaN();

class Surveyor {
 public:
  Surveyor(TableFile& file, const ImportTime& time, const std::vector<std::size_t>& sampled)
      : file_(file), time_(time), clock_(time, file.layout().mark) {
    survey_.columns.resize(file.layout().headings.size());
    survey_.sample.columns = sampled;
    values_.resize(survey_.columns.size());
  }

  Expected<TableSurvey> run(const ImportProgress& progress) {
    if (auto done = file_.rewind(); !done) return done.error();
    for (TableRow row;;) {
      const auto more = file_.next(row);
      if (!more) return more.error();
      if (!*more) break;
      for (std::size_t i = 0; i < row.fields.size(); ++i) take(i, row.fields[i], row.line);
      take_time(row);
      take_sample();
      ++survey_.rows;
      if (progress && survey_.rows % 4096 == 0) progress(file_.progress());
    }
    finish();
    return std::move(survey_);
  }

 private:
  void take(std::size_t column, std::string_view field, std::size_t line) {
    ColumnSurvey& c = survey_.columns[column];
    if (c.first.size() < 3) c.first.push_back(printable(field, 24));
    const TableNumber number = table_number(field, file_.layout().mark);
    values_[column] = kNoValue;
    switch (number.state) {
      case TableNumber::State::value:
        ++c.values;
        c.least = std::min(c.least, number.value);
        c.greatest = std::max(c.greatest, number.value);
        c.whole = c.whole && number.value == std::floor(number.value);
        values_[column] = number.value;
        break;
      case TableNumber::State::empty:
        ++c.empty;
        break;
      case TableNumber::State::invalid:
        ++c.invalid;
        break;
      case TableNumber::State::text:
        if (c.texts++ == 0) {
          c.text = printable(field, 30);
          c.text_line = line;
        }
        break;
    }
  }

  void take_time(const TableRow& row) {
    if (time_.source == ImportTime::Source::none) return;
    TimeSurvey& t = survey_.time;
    const auto now = clock_.read(row);
    if (!now) {
      if (t.unread_line == 0) {
        t.unread_line = row.line;
        t.unread = printable(row.fields[time_.column], 30);
      }
      now_s_ = kNoValue;
      return;
    }
    if (t.read++ == 0) t.first_ns = *now;
    if (t.read > 1) {
      if (*now <= t.last_ns) {
        if (t.not_later++ == 0) t.not_later_line = row.line;
      } else {
        t.longest_step_s = std::max(t.longest_step_s, seconds_from(*now - t.last_ns));
      }
    }
    t.last_ns = *now;
    now_s_ = seconds_from(*now - t.first_ns);
  }

  void take_sample() {
    RowSample& sample = survey_.sample;
    const std::size_t stretch = survey_.rows / RowSample::kStretch;
    if (stretch % every_ != 0) return;
    if (survey_.rows % RowSample::kStretch == 0) {
      if (sample.t_s.size() == RowSample::kMostStretches) thin();
      if (stretch % every_ != 0) return;
      sample.t_s.emplace_back();
      sample.values.emplace_back();
    }
    if (sample.t_s.empty()) return;
    sample.t_s.back().push_back(now_s_);
    for (const std::size_t column : sample.columns) sample.values.back().push_back(values_[column]);
  }

  /// Keeps every other stretch.
  void thin() {
    RowSample& sample = survey_.sample;
    for (std::size_t i = 0; 2 * i < sample.t_s.size(); ++i) {
      sample.t_s[i] = std::move(sample.t_s[2 * i]);
      sample.values[i] = std::move(sample.values[2 * i]);
    }
    sample.t_s.resize((sample.t_s.size() + 1) / 2);
    sample.values.resize(sample.t_s.size());
    every_ *= 2;
  }

  void finish() {
    std::vector<double> steps;
    for (const std::vector<double>& t : survey_.sample.t_s)
      for (std::size_t i = 1; i < t.size(); ++i)
        if (const double step = t[i] - t[i - 1]; step > 0) steps.push_back(step);
    survey_.time.median_step_s = kNoValue;
    if (!steps.empty()) {
      const auto middle = steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2);
      std::nth_element(steps.begin(), middle, steps.end());
      survey_.time.median_step_s = *middle;
    }
    survey_.time.midnights = clock_.midnights();
    survey_.ragged = file_.ragged();
  }

  TableFile& file_;
  const ImportTime& time_;
  ImportClock clock_;
  TableSurvey survey_;
  std::vector<double> values_;
  double now_s_ = kNoValue;
  std::size_t every_ = 1;
};

}  // namespace

Expected<TableSurvey> survey_table(TableFile& file, const ImportTime& time,
                                   const std::vector<std::size_t>& sampled,
                                   const ImportProgress& progress) {
  return Surveyor(file, time, sampled).run(progress);
}

}  // namespace servosense::detail
