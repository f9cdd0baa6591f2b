#compdef skillctl
# Completion of skillctl for zsh, printed by `skillctl completion zsh`.
_skillctl() {
    local -a answer spaced open
    local line word
    answer=("${(@f)$("${(Q)words[1]}" __complete words "${(@Q)words[2,CURRENT-1]}" "${(Q)PREFIX}" 2>/dev/null)}")
    for line in "${(@)answer[2,-1]}"; do
        word="${line%%$'\t'*}"
        line="${word//:/\\:}${${line#"$word"}:+:${line#*$'\t'}}"
        if [[ $word == *[/=] ]]; then open+=("$line"); else spaced+=("$line"); fi
    done
    (( $#spaced )) && _describe -V 'skillctl' spaced
    (( $#open )) && _describe -V 'skillctl' open -S ''
    case "${answer[1]}" in
        files*) compset -p "${answer[1]#* }"; _files ;;
        directories*) compset -p "${answer[1]#* }"; _files -/ ;;
    esac
}
(( $+functions[compdef] )) || { autoload -Uz compinit && compinit; }
compdef _skillctl skillctl
