// Quality flags: one bit each, one name each, and which of them make a value unusable.
#include <bit>
#include <set>
#include <string>

#include "check.hpp"
#include "servosense/core/quality.hpp"

namespace {

using servosense::has;
using servosense::kUnusable;
using servosense::name_of;
using servosense::Quality;

constexpr Quality kAll[] = {Quality::held,      Quality::invalid,   Quality::missing,
                            Quality::gap,       Quality::duplicate, Quality::reordered,
                            Quality::late,      Quality::stuck,     Quality::jump,
                            Quality::saturated, Quality::dead_bus,  Quality::restarted,
                            Quality::settling,  Quality::doubtful,  Quality::stale};

void one_bit_each() {
  std::set<std::string> names;
  unsigned bits = 0;
  for (const Quality flag : kAll) {
    const auto value = static_cast<unsigned>(flag);
    CHECK(std::has_single_bit(value));
    CHECK((bits & value) == 0);
    bits |= value;
    CHECK(std::string(name_of(flag)) != "");
    CHECK(names.insert(name_of(flag)).second);
  }
  CHECK_TEXT(name_of(Quality::good), "good");
  CHECK_TEXT(name_of(Quality::dead_bus), "dead-bus");
  CHECK_TEXT(name_of(Quality::gap | Quality::held), "");
}

void sets() {
  Quality q = Quality::good;
  CHECK(!has(q, kUnusable));
  q |= Quality::held;
  CHECK(has(q, Quality::held) && !has(q, kUnusable));  // a slower channel is no fault
  q |= Quality::jump;
  CHECK(has(q, kUnusable) && has(q, Quality::held));
  CHECK((q & Quality::jump) == Quality::jump);
  for (const Quality flag :
       {Quality::invalid, Quality::missing, Quality::duplicate, Quality::reordered, Quality::late,
        Quality::stuck, Quality::jump, Quality::dead_bus, Quality::stale})
    CHECK(has(kUnusable, flag));
  for (const Quality flag : {Quality::held, Quality::gap, Quality::saturated, Quality::restarted,
                             Quality::settling, Quality::doubtful})
    CHECK(!has(kUnusable, flag));
}

}  // namespace

int main() {
  one_bit_each();
  sets();
  return check::done();
}
