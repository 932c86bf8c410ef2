// F words found and written in the text of a program.
#include <map>
#include <string>

#include "check.hpp"
#include "servosense/process/optimise/word_text.hpp"

namespace {

using namespace servosense::process;

std::string word(const std::string& line) {
  const CodeWord found = code_word_of(line, 'F');
  if (!found.found()) return "-";
  return (found.plain ? "" : "?") + line.substr(found.begin, found.end - found.begin);
}

void words() {
  CHECK_TEXT(word("G1 X10 F300"), "F300");
  CHECK_TEXT(word("g1x10f1.5y2"), "f1.5");
  CHECK_TEXT(word("G1 F 300 X1"), "F 300");
  CHECK_TEXT(word("G1 F[#1*[2+1]] X1"), "F[#1*[2+1]]");
  CHECK_TEXT(word("G1 F#1 X1"), "F#1");
  CHECK_TEXT(word("G1 F#<_feed> X1"), "F#<_feed>");
  CHECK_TEXT(word("G1 F##3 X1"), "F##3");
  CHECK_TEXT(word("(F100) G1 X1 ; F200"), "-");
  CHECK_TEXT(word("G1 X#<off> Y[FIX[2]]"), "-");
  CHECK_TEXT(word("O100 IF [#1 GT 2]"), "-");
  CHECK_TEXT(word("O100 endif"), "-");
  CHECK_TEXT(word("G1 X1 FABS[3]"), "?F");
  CHECK_TEXT(word("G1 X1 F ABS[3]"), "?F");
  CHECK_TEXT(word(""), "-");
  // S likewise, and not that of another word.
  const auto speed = [](const std::string& line) {
    const CodeWord found = code_word_of(line, 'S');
    return found.found() ? line.substr(found.begin, found.end - found.begin) : "-";
  };
  CHECK_TEXT(speed("T1 M6 S1200 M3 F300"), "S1200");
  CHECK_TEXT(speed("g97s900m3"), "s900");
  CHECK_TEXT(speed("(S100) G1 X[SIN[30]] ; S200"), "-");
}

void writing() {
  const std::string text = "G1 X1 F100\r\nG1 X2 (a (b) c)\r\nX3   ; end F9\n\nF50\nG1 Y[1+2]";
  CHECK_TEXT(with_words(text, 'F', {}), text);
  const std::map<std::size_t, std::string> feeds = {{1, "250"}, {2, "99.5"}, {3, "7"}, {6, "80"}};
  CHECK_TEXT(with_words(text, 'F', feeds),
             "G1 X1 F250\r\nG1 X2F99.5 (a (b) c)\r\nX3F7   ; end F9\n\nF50\nG1 Y[1+2]F80");
  CHECK_TEXT(with_words("G1 F[2*3]X1\n", 'F', {{1, "8"}}), "G1 F8X1\n");
  CHECK_TEXT(with_words("S500 M3 F10\nS600\n", 'S', {{1, "750"}}), "S750 M3 F10\nS600\n");
}

void digits() {
  CHECK_TEXT(word_digits(1234.567), "1234.5");
  CHECK_TEXT(word_digits(300), "300");
  CHECK_TEXT(word_digits(123456.7), "123456");
  CHECK_TEXT(word_digits(0.0123456), "0.012345");
  CHECK_TEXT(word_digits(99.9999999), "99.999");
}

}  // namespace

int main() {
  words();
  writing();
  digits();
  return check::done();
}
