// Words, numbers, texts and symbols of a DBC file.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string_view>

namespace servosense::dbc {

struct Token {
  enum class Kind : std::uint8_t { end, name, number, text, symbol, open_text };
  Kind kind = Kind::end;
  std::string_view text;  // of a text, without its quotes
  std::size_t line = 1;
  bool first = true;  // on its line
};

class Lexer {
 public:
  explicit Lexer(std::string_view text) : text_(text) {
    if (text_.starts_with("\xEF\xBB\xBF")) at_ = 3;
  }

  Token next() {
    bool first = at_ == 0 || line_ == 0;
    if (line_ == 0) line_ = 1;
    while (at_ < text_.size() && blank(text_[at_])) {
      if (text_[at_] == '\n') {
        ++line_;
        first = true;
      }
      ++at_;
    }
    Token token{Token::Kind::end, {}, line_, first};
    if (at_ == text_.size()) return token;
    const std::size_t begin = at_;
    const char c = text_[at_];
    if (c == '"') {
      token.kind = quoted() ? Token::Kind::text : Token::Kind::open_text;
      token.text = text_.substr(begin + 1, at_ - begin - 1);
      if (token.kind == Token::Kind::text) token.text.remove_suffix(1);
      return token;
    }
    if (letter(c)) {
      while (at_ < text_.size() && (letter(text_[at_]) || digit(text_[at_]))) ++at_;
      token.kind = Token::Kind::name;
    } else if (digit(c) || (sign(c) && at_ + 1 < text_.size() &&
                            (digit(text_[at_ + 1]) || text_[at_ + 1] == '.'))) {
      number();
      token.kind = Token::Kind::number;
      const bool word = text_.substr(begin, at_ - begin).find_first_of(".+-") == text_.npos;
      if (word && at_ < text_.size() && letter(text_[at_])) {  // a name that begins with a digit
        while (at_ < text_.size() && (letter(text_[at_]) || digit(text_[at_]))) ++at_;
        token.kind = Token::Kind::name;
      }
    } else {
      ++at_;
      token.kind = Token::Kind::symbol;
    }
    token.text = text_.substr(begin, at_ - begin);
    return token;
  }

 private:
  static bool blank(char c) { return c == ' ' || c == '\t' || c == '\r' || c == '\n'; }
  static bool digit(char c) { return c >= '0' && c <= '9'; }
  static bool sign(char c) { return c == '+' || c == '-'; }
  static bool letter(char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_';
  }
  void number() {
    ++at_;
    while (at_ < text_.size()) {
      const char c = text_[at_];
      const bool exponent =
          (c == 'e' || c == 'E') && at_ + 1 < text_.size() &&
          (digit(text_[at_ + 1]) ||
           (sign(text_[at_ + 1]) && at_ + 2 < text_.size() && digit(text_[at_ + 2])));
      if (exponent)
        at_ += 2;
      else if (digit(c) || c == '.')
        ++at_;
      else
        return;
    }
  }
  // Past a text in quotes, which may go over lines; false if it does not end.
  bool quoted() {
    for (++at_; at_ < text_.size(); ++at_) {
      const char c = text_[at_];
      if (c == '\n') ++line_;
      if (c == '\\' && at_ + 1 < text_.size() && text_[at_ + 1] == '"') ++at_;
      if (c == '"') {
        ++at_;
        return true;
      }
    }
    return false;
  }

  std::string_view text_;
  std::size_t at_ = 0;
  std::size_t line_ = 0;
};

}  // namespace servosense::dbc
